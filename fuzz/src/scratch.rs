//! Readers take paths: bytes as a file, in memory where there is such a folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;

/// Calls `read` with the path of a file that holds `bytes` and whose name ends in `.ending`; one a thread, written over each time.
pub fn with_file<T>(ending: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    let memory = Path::new("/dev/shm");
    let parent = if memory.is_dir() {
        memory.to_owned()
    } else {
        std::env::temp_dir()
    };
    let thread = format!("{:?}", thread::current().id()).replace(['(', ')'], "");
    let folder: PathBuf = parent.join(format!("omniwalk-fuzz-{}-{thread}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join(format!("input.{ending}"));
    fs::write(&path, bytes).expect("room for the input");
    let result = read(&path);
    // Removed, as a fuzzer that ends itself by a signal drops nothing.
    fs::remove_dir_all(&folder).expect("the folder");
    result
}
