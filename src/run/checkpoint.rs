//! A checkpoint: named tensors and a little metadata in one safetensors file.
//!
//! The file's own metadata has one entry, `omniwalk`: JSON with the step, the metadata and a CRC-32C over
//! everything, so that a flipped bit is noticed and not trained on. Same content, same bytes.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use safetensors::tensor::SafeTensors;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;

use super::atomic::write_atomic;
use super::tensor::{Data, Element, Tensor};

/// Largest checkpoint that is read, bytes.
pub const MAX_CHECKPOINT_BYTES: u64 = 1 << 30;

const FORMAT: u32 = 1;
const ENTRY: &str = "omniwalk";

/// Why a checkpoint cannot be written, read or used.
#[derive(Debug, Error, Diagnostic)]
pub enum CheckpointError {
    /// The file system said no.
    #[error("cannot {action} {}: {why}", .path.display())]
    Io {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
    /// None of a run's checkpoints can be read.
    #[error("none of the {files} checkpoints in {} is whole; of the newest: {newest}", .folder.display())]
    #[diagnostic(help(
        "what the run had learned is lost but for a policy that was exported; train anew in another folder by `--run DIR`"
    ))]
    NoneWhole {
        /// The folder of the checkpoints.
        folder: PathBuf,
        /// How many there are.
        files: usize,
        /// Why the newest cannot be read.
        newest: Box<CheckpointError>,
    },
    /// The file is not a checkpoint, or is damaged.
    #[error("{} is not a whole checkpoint: {why}", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// The checkpoint does not hold what is asked of it.
    #[error("the checkpoint has no {kind} tensor `{name}`{found}")]
    #[diagnostic(help("it was written with another configuration or by another version of omniwalk"))]
    NoTensor {
        /// The element type asked for.
        kind: &'static str,
        /// The tensor asked for.
        name: String,
        /// What is there instead, if anything.
        found: String,
    },
}

/// Everything training needs to go on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checkpoint {
    /// Policy steps done.
    pub step: u64,
    /// Tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
    /// What describes the checkpoint to a reader. Numbers that must come back bit by bit belong into tensors.
    pub metadata: BTreeMap<String, Value>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    crc32c: u32,
    format: u32,
    metadata: BTreeMap<String, Value>,
    step: u64,
}

impl Checkpoint {
    /// An empty checkpoint at `step`.
    pub fn new(step: u64) -> Self {
        Self {
            step,
            ..Self::default()
        }
    }

    /// Adds `values` of shape `shape` as `name`.
    ///
    /// # Panics
    /// When the number of values is not the product of `shape`: that is a mistake of the caller, not of an input.
    pub fn insert<T: Element>(&mut self, name: impl Into<String>, shape: &[usize], values: &[T]) {
        assert_eq!(
            shape.iter().product::<usize>(),
            values.len(),
            "a tensor has as many values as its shape says"
        );
        self.tensors.insert(
            name.into(),
            Tensor {
                shape: shape.to_vec(),
                data: T::wrap(values.to_vec()),
            },
        );
    }

    /// The elements of tensor `name` with exactly `len` of them.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] when there is none of that name, type and length.
    pub fn get<T: Element>(&self, name: &str, len: usize) -> Result<&[T], CheckpointError> {
        let values = self.get_any::<T>(name)?;
        if values.len() == len {
            return Ok(values);
        }
        let found = format!(" of {len} elements; it has {}", values.len());
        Err(CheckpointError::NoTensor {
            kind: T::NAME,
            name: name.to_owned(),
            found,
        })
    }

    /// The elements of tensor `name`, however many.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] when there is none of that name and type.
    pub fn get_any<T: Element>(&self, name: &str) -> Result<&[T], CheckpointError> {
        let tensor = self.tensors.get(name);
        tensor
            .and_then(|tensor| T::unwrap(&tensor.data))
            .ok_or_else(|| CheckpointError::NoTensor {
                kind: T::NAME,
                name: name.to_owned(),
                found: tensor
                    .map(|tensor| format!("; it is {}", tensor.data.kind()))
                    .unwrap_or_default(),
            })
    }

    /// Writes the checkpoint to `path`, whole or not at all.
    ///
    /// # Errors
    /// [`CheckpointError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), CheckpointError> {
        let error = |why| CheckpointError::Io {
            action: "write",
            path: path.to_owned(),
            why,
        };
        let bytes = self.to_bytes().map_err(|why| error(std::io::Error::other(why)))?;
        write_atomic(path, &bytes).map_err(error)
    }

    /// Reads the checkpoint at `path`.
    ///
    /// # Errors
    /// [`CheckpointError::Io`] or [`CheckpointError::Damaged`].
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let error = |why| CheckpointError::Io {
            action: "read",
            path: path.to_owned(),
            why,
        };
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_CHECKPOINT_BYTES + 1).read_to_end(&mut bytes))
            .map_err(error)?;
        let damaged = |why| CheckpointError::Damaged {
            path: path.to_owned(),
            why,
        };
        if bytes.len() as u64 > MAX_CHECKPOINT_BYTES {
            return Err(damaged("it is larger than 1 GiB".to_owned()));
        }
        Self::from_bytes(&bytes).map_err(damaged)
    }

    fn to_bytes(&self) -> Result<Vec<u8>, String> {
        let header = Header {
            crc32c: self.checksum(),
            format: FORMAT,
            metadata: self.metadata.clone(),
            step: self.step,
        };
        let json = serde_json::to_string(&header).map_err(|error| error.to_string())?;
        let entry = HashMap::from([(ENTRY.to_owned(), json)]);
        safetensors::serialize(&self.tensors, Some(entry)).map_err(|error| error.to_string())
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
        let json = metadata.metadata().as_ref().and_then(|entries| entries.get(ENTRY));
        let json = json.ok_or("it is a safetensors file of another program")?;
        let header: Header = serde_json::from_str(json).map_err(|error| format!("its metadata is broken: {error}"))?;
        if header.format != FORMAT {
            return Err(format!(
                "it has format {}, this program reads format {FORMAT}",
                header.format
            ));
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let mut checkpoint = Self {
            step: header.step,
            metadata: header.metadata,
            tensors: BTreeMap::new(),
        };
        for (name, view) in tensors.iter() {
            let data = Data::from_bytes(view.dtype(), view.data())
                .ok_or_else(|| format!("tensor `{name}` has the unknown type {}", view.dtype()))?;
            checkpoint.tensors.insert(
                name.to_owned(),
                Tensor {
                    shape: view.shape().to_vec(),
                    data,
                },
            );
        }
        if checkpoint.checksum() != header.crc32c {
            return Err("its checksum is wrong".to_owned());
        }
        Ok(checkpoint)
    }

    /// CRC-32C over step, metadata and tensors in the order of their names.
    fn checksum(&self) -> u32 {
        let mut crc = crc32c::crc32c(&self.step.to_le_bytes());
        for (name, value) in &self.metadata {
            crc = crc32c::crc32c_append(crc, format!("{name}={value}\n").as_bytes());
        }
        for (name, tensor) in &self.tensors {
            let description = format!("{name}:{}{:?}\n", tensor.data.kind(), tensor.shape);
            crc = crc32c::crc32c_append(crc, description.as_bytes());
            crc = crc32c::crc32c_append(crc, &tensor.data.to_bytes());
        }
        crc
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn example() -> Checkpoint {
        let mut checkpoint = Checkpoint::new(123_456);
        checkpoint.insert(
            "actor.0.weight",
            &[2, 3],
            &[1.0_f32, -0.0, f32::NAN, 3.5, f32::MIN_POSITIVE, -7.25],
        );
        checkpoint.insert("normaliser.count", &[], &[1e9_f64]);
        checkpoint.insert("random.stream", &[2], &[u64::MAX, 7]);
        checkpoint.insert("environment.0", &[5], b"bytes".as_slice());
        checkpoint.insert::<u8>("empty", &[0], &[]);
        checkpoint.metadata.insert("seed".into(), Value::from(u64::MAX));
        checkpoint
            .metadata
            .insert("learning_rate".into(), Value::from(0.1 + 0.2));
        checkpoint
    }

    #[test]
    fn everything_comes_back_bit_by_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let written = example();
        written.write(&path).unwrap();
        let read = Checkpoint::read(&path).unwrap();
        assert_eq!((read.step, &read.metadata), (written.step, &written.metadata));
        let bytes = |checkpoint: &Checkpoint| {
            checkpoint
                .tensors
                .iter()
                .map(|(n, t)| (n.clone(), t.shape.clone(), t.data.to_bytes().to_vec()))
                .collect::<Vec<_>>()
        };
        // Compared as bytes, because NaN is not equal to itself.
        assert_eq!(bytes(&read), bytes(&written));
        assert_eq!(read.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    }

    #[test]
    fn a_missing_mistyped_or_missized_tensor_is_named() {
        let checkpoint = example();
        let message = |error: CheckpointError| error.to_string();
        assert_eq!(checkpoint.get::<u64>("random.stream", 2).unwrap(), [u64::MAX, 7]);
        assert!(message(checkpoint.get::<f32>("critic", 2).unwrap_err()).contains("no f32 tensor `critic`"));
        assert!(message(checkpoint.get::<f32>("random.stream", 2).unwrap_err()).contains("it is u64"));
        assert!(message(checkpoint.get::<u64>("random.stream", 3).unwrap_err()).contains("it has 2"));
    }

    #[test]
    fn a_safetensors_file_of_another_program_is_refused() {
        let tensor = Tensor {
            shape: vec![1],
            data: Data::F32(vec![1.0]),
        };
        let bytes = safetensors::serialize([("a", &tensor)], None).unwrap();
        assert!(Checkpoint::from_bytes(&bytes).unwrap_err().contains("another program"));
    }

    proptest! {
        #[test]
        fn every_flipped_bit_and_every_cut_is_noticed(position: prop::sample::Index, bit in 0_u8..8) {
            let mut bytes = example().to_bytes().unwrap();
            let at = position.index(bytes.len());
            prop_assert!(Checkpoint::from_bytes(&bytes[..at]).is_err());
            bytes[at] ^= 1 << bit;
            if let Ok(read) = Checkpoint::from_bytes(&bytes) {
                // Only the padding of the header carries nothing.
                prop_assert_eq!(read.to_bytes().unwrap(), example().to_bytes().unwrap());
            }
        }
    }
}
