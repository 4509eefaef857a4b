//! Files that a user names: what is read is a regular file of a bounded size, and what will be written can be.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use miette::{IntoDiagnostic, WrapErr};

/// Opens the regular file at `path`. A pipe would be waited for without an end, and a device gives no end.
///
/// # Errors
/// Whatever the file system says, and what is not a regular file.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = fs::metadata(path)?.file_type();
    if kind.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !kind.is_file() {
        return Err(irregular());
    }
    File::open(path)
}

/// The content of the regular file at `path`, which may have `limit` bytes at most.
///
/// # Errors
/// Those of [`open`], and [`io::ErrorKind::FileTooLarge`].
pub fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        let why = format!("it is larger than {limit} bytes");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, why));
    }
    Ok(bytes)
}

/// Whether a file can be written at `path`, found out before anything is done that takes its time or writes other files.
/// What is there stays as it is.
///
/// # Errors
/// When `path` is a folder, its folder does not exist, or nothing can be written there.
pub fn can_write(path: &Path) -> miette::Result<()> {
    let found = if path.is_dir() {
        Err(io::ErrorKind::IsADirectory.into())
    } else if path.exists() && !path.is_file() {
        Err(irregular())
    } else {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        probe(folder.unwrap_or(Path::new(".")))
    };
    found
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}

fn irregular() -> io::Error {
    let why = "it is a pipe or a device, not a regular file";
    io::Error::new(io::ErrorKind::InvalidInput, why)
}

/// Makes a file in `folder` and takes it away again.
fn probe(folder: &Path) -> io::Result<()> {
    let probe = folder.join(format!(".omniwalk-{}.probe", std::process::id()));
    File::create_new(&probe)?;
    fs::remove_file(probe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_written_is_known_before_and_leaves_no_trace() {
        let folder = tempfile::tempdir().unwrap();
        can_write(&folder.path().join("a.json")).unwrap();
        for path in [folder.path().to_owned(), folder.path().join("none/a.json")] {
            let message = can_write(&path).unwrap_err().to_string();
            assert!(message.contains("cannot write"), "{message}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_file_beyond_its_bound_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "1234").unwrap();
        assert_eq!(read(&path, 4).unwrap(), b"1234");
        assert_eq!(read(&path, 3).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_neither_read_nor_replaced() {
        let null = Path::new("/dev/null");
        assert!(open(null).unwrap_err().to_string().contains("not a regular file"));
        assert!(can_write(null).is_err());
    }
}
