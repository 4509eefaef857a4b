//! What dear computations led to, kept in a file while an identification lasts: one that is interrupted goes on from there, to the same
//! bits.
//!
//! A record has a key, a hash of all that its numbers follow from; how many they are; the numbers; and a hash of these. The file begins
//! with what all records follow from (this program, the robot, the logs); one in which that is another is left as it is, and refused. What
//! was torn off while it was written is cut away.

use std::collections::HashMap;
use std::fmt::{self, Debug, Write as _};
use std::fs::{File, OpenOptions, TryLockError};
use std::hash::{DefaultHasher, Hasher};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Bytes of a number and of a key.
const NUMBER: usize = 8;
/// Longest file that is read, bytes.
const LONGEST: u64 = 1 << 30;

/// What is wrong where two write into one folder.
const BUSY: &str = "another `omniwalk identify` is at work in this folder";

/// What is wrong where something else was interrupted: hours may be in it.
const ANOTHER: &str = "it is what another identification came to before it was interrupted (of other logs, of another robot or by another \
                       version of omniwalk); take another folder, or remove this file to begin anew";

/// A hash of how something is written by [`Debug`], which tells floating-point numbers apart to the last bit.
#[derive(Default)]
struct Written(DefaultHasher);

impl fmt::Write for Written {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// The hash of `what`, the same in every run of this program.
pub fn hash(what: &dyn Debug) -> u64 {
    let mut written = Written::default();
    // A hash takes everything.
    let _ = write!(written, "{what:?}");
    written.0.finish()
}

/// The hash of some numbers.
pub fn hash_of_numbers(numbers: impl Iterator<Item = f64>) -> u64 {
    let mut hasher = DefaultHasher::new();
    numbers.for_each(|number| hasher.write_u64(number.to_bits()));
    hasher.finish()
}

/// Numbers by the hash of what they follow from, in a file.
#[derive(Debug)]
pub struct Journal {
    file: Mutex<File>,
    known: HashMap<u64, Vec<f64>>,
}

impl Journal {
    /// Opens the journal at `path` of what follows from `all`, or begins it; nobody else can until it is dropped.
    ///
    /// # Errors
    /// When the file cannot be read or written, another identification has it open, or it is another one's.
    pub fn open(path: &Path, all: &dyn Debug) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        let mut file = options.read(true).write(true).create(true).truncate(false).open(path)?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => io::Error::new(io::ErrorKind::ResourceBusy, BUSY),
            TryLockError::Error(why) => why,
        })?;
        let mut bytes = Vec::new();
        (&mut file).take(LONGEST).read_to_end(&mut bytes)?;
        let head = (hash(all) ^ program()).to_le_bytes();
        let (known, end) = match bytes.strip_prefix(&head) {
            Some(records) => read(records),
            None if bytes.len() > head.len() => return Err(io::Error::new(io::ErrorKind::AlreadyExists, ANOTHER)),
            None => (HashMap::new(), 0),
        };
        file.rewind()?;
        file.write_all(&head)?;
        let end = (head.len() + end) as u64;
        file.set_len(end)?;
        file.seek(SeekFrom::Start(end))?;
        Ok(Self {
            file: Mutex::new(file),
            known,
        })
    }

    /// How many results an interrupted identification left.
    pub fn len(&self) -> usize {
        self.known.len()
    }

    /// The numbers with this `key`, if an interrupted identification came to them.
    pub fn known(&self, key: u64) -> Option<&[f64]> {
        self.known.get(&key).map(Vec::as_slice)
    }

    /// Keeps `numbers` for the next one.
    pub fn keep(&self, key: u64, numbers: &[f64]) {
        let count = numbers.len() as u64;
        let mut record = Vec::with_capacity(NUMBER * (numbers.len() + 3));
        record.extend_from_slice(&key.to_le_bytes());
        record.extend_from_slice(&count.to_le_bytes());
        numbers.iter().for_each(|n| record.extend_from_slice(&n.to_le_bytes()));
        record.extend_from_slice(&hash_of_numbers(numbers.iter().copied()).to_le_bytes());
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // What is not kept is computed again: no reason to end here.
        let _ = file.write_all(&record);
    }
}

/// A hash of this program: another may come to other numbers.
fn program() -> u64 {
    let bytes = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
    let mut hasher = DefaultHasher::new();
    hasher.write(&bytes);
    hasher.finish()
}

/// The whole records that `bytes` begin with, and how long they are.
fn read(bytes: &[u8]) -> (HashMap<u64, Vec<f64>>, usize) {
    let mut known = HashMap::new();
    let mut rest = bytes;
    while let Some((key, numbers, after)) = record(rest) {
        known.insert(key, numbers);
        rest = after;
    }
    (known, bytes.len() - rest.len())
}

/// The record that `bytes` begin with, if it is whole, and what comes after it.
fn record(bytes: &[u8]) -> Option<(u64, Vec<f64>, &[u8])> {
    let (key, rest) = bytes.split_first_chunk()?;
    let (count, rest) = rest.split_first_chunk()?;
    let length = usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(NUMBER)?;
    let (body, rest) = rest.split_at_checked(length)?;
    let (sum, rest) = rest.split_first_chunk()?;
    let number = |chunk: &[u8]| chunk.try_into().map(f64::from_le_bytes);
    let numbers: Vec<f64> = body.chunks(NUMBER).map(number).collect::<Result<_, _>>().ok()?;
    let whole = hash_of_numbers(numbers.iter().copied()) == u64::from_le_bytes(*sum);
    whole.then(|| (u64::from_le_bytes(*key), numbers, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_records_are_known_again_and_torn_ones_are_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let journal = Journal::open(&path, &"these logs").expect("a journal");
        let numbers = [vec![], vec![1.5, f64::NAN, -0.0], vec![0.1; 9]];
        numbers.iter().zip(7..).for_each(|(own, key)| journal.keep(key, own));
        drop(journal);
        let whole = std::fs::read(&path).expect("a file");
        let last = NUMBER * (9 + 3);
        for cut in 0..=last {
            std::fs::write(&path, &whole[..whole.len() - cut]).expect("written");
            let journal = Journal::open(&path, &"these logs").expect("a journal");
            assert_eq!(journal.len(), if cut == 0 { 3 } else { 2 });
            let bits = |own: &[f64]| own.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(journal.known(8).expect("known")), bits(&numbers[1]));
            // What comes after is whole again.
            journal.keep(10, &[4.0]);
            drop(journal);
            let again = Journal::open(&path, &"these logs").expect("a journal");
            assert_eq!(again.known(10), Some(&[4.0][..]));
        }
        let mut flipped = whole.clone();
        flipped[whole.len() - last / 2] ^= 1;
        std::fs::write(&path, flipped).expect("written");
        assert_eq!(Journal::open(&path, &"these logs").expect("a journal").len(), 2);
    }

    #[test]
    fn a_journal_of_other_logs_is_left_as_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let other = 1.0_f64.next_up();
        drop(Journal::open(&path, &other).expect("a journal"));
        // Nothing is lost where nothing was kept.
        Journal::open(&path, &1.0).expect("a journal").keep(1, &[2.0]);
        let refused = Journal::open(&path, &other).expect_err("a refusal");
        assert!(refused.to_string().contains("of other logs"), "{refused}");
        let journal = Journal::open(&path, &1.0).expect("a journal");
        assert_eq!(journal.known(1), Some(&[2.0][..]));
    }

    #[test]
    fn two_cannot_keep_one_journal_at_a_time() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let first = Journal::open(&path, &1.0).expect("a journal");
        first.keep(1, &[2.0]);
        let refused = Journal::open(&path, &1.0).expect_err("a refusal");
        assert!(refused.to_string().contains("another `omniwalk identify`"), "{refused}");
        drop(first);
        assert_eq!(Journal::open(&path, &1.0).expect("a journal").len(), 1);
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_as_far_as_they_are_whole(bytes in proptest::collection::vec(0_u8.., 0..200)) {
            let (known, end) = read(&bytes);
            proptest::prop_assert!(end <= bytes.len() && known.len() <= end / (3 * NUMBER));
        }
    }
}
