//! The policy file (`.omni`): one file that holds all a robot needs to run a policy. `docs/policy-file.md` describes every byte.
//!
//! ```text
//! magic, version, length, table of sections, checksum | spec | actor | bounds | identity | golden vectors
//! ```
//!
//! Every byte is under a checksum and none is left over, so a damaged file is refused; a file that was made to deceive
//! is bounded by its own length before anything is allocated, validated like one that was just built, and must reproduce its golden vectors.

mod codec;

use alloc::vec::Vec;

use thiserror::Error;

use crate::policy::{Policy, PolicyError};

/// First bytes of every policy file.
pub const MAGIC: [u8; 8] = *b"OMNIWALK";

/// Version that is written, and the only one that is read.
pub const VERSION: u32 = 1;

/// Longest file that is read, bytes.
pub const MAX_LEN: usize = 16 << 20;

const SECTIONS: [(&str, [u8; 4]); 5] = [
    ("spec", *b"spec"),
    ("actor", *b"actr"),
    ("bounds", *b"bnds"),
    ("identity", *b"iden"),
    ("golden vectors", *b"gold"),
];
const TABLE_AT: usize = 20;
const ENTRY_LEN: usize = 12;
const CHECKSUM_AT: usize = TABLE_AT + SECTIONS.len() * ENTRY_LEN;
const HEADER_LEN: usize = CHECKSUM_AT + 4;

/// Why bytes are not a policy.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FileError {
    /// The file does not start as one.
    #[error("not a policy file: it does not begin with OMNIWALK")]
    Magic,
    /// From another version of the program.
    #[error("policy file version {found}, but this program reads version {VERSION}: export the policy again")]
    Version {
        /// The file's.
        found: u32,
    },
    /// Cut off, or something was appended.
    #[error("the file has {found} bytes instead of {expected}: it was cut off or changed")]
    Length {
        /// What the header says, or a header's length.
        expected: usize,
        /// What there is.
        found: usize,
    },
    /// Larger than any policy.
    #[error("the file has {found} bytes; a policy has at most {MAX_LEN}")]
    TooLong {
        /// What there is.
        found: usize,
    },
    /// A header that is not intact.
    #[error("the header is damaged (checksum): copy or export the file again")]
    Header,
    /// A section that is not intact.
    #[error("section {section} is damaged (checksum): copy or export the file again")]
    Checksum {
        /// Which one.
        section: &'static str,
    },
    /// The table of sections is not that of this version.
    #[error("the table of sections is not that of version {VERSION}")]
    Table,
    /// A section whose bytes mean nothing.
    #[error("section {section}, byte {offset}: {problem}")]
    Malformed {
        /// Which one.
        section: &'static str,
        /// Where in it.
        offset: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// The file is intact but holds no working policy.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

impl Policy {
    /// The policy as a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let sections = [
            codec::encode(&self.spec),
            codec::encode(&self.actor),
            codec::encode(&self.bounds),
            codec::encode(&self.identity),
            codec::encode(&self.golden),
        ];
        let len = HEADER_LEN + sections.iter().map(Vec::len).sum::<usize>();
        let mut bytes = Vec::with_capacity(len);
        bytes.extend_from_slice(&MAGIC);
        for number in [VERSION, SECTIONS.len() as u32, len as u32] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        for ((_, tag), section) in SECTIONS.iter().zip(&sections) {
            bytes.extend_from_slice(tag);
            bytes.extend_from_slice(&(section.len() as u32).to_le_bytes());
            bytes.extend_from_slice(&crc32(section).to_le_bytes());
        }
        let checksum = crc32(&bytes);
        bytes.extend_from_slice(&checksum.to_le_bytes());
        sections.iter().for_each(|section| bytes.extend_from_slice(section));
        bytes
    }

    /// Reads a file, checks everything and runs its golden vectors.
    ///
    /// # Errors
    /// What is wrong with the file and what to do about it. No input makes it panic or allocate more than a small multiple of
    /// the file's own length.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FileError> {
        let sections = sections(bytes)?;
        let [spec, actor, bounds, identity, golden] = sections;
        let policy = Self {
            spec: codec::decode("spec", spec)?,
            actor: codec::decode("actor", actor)?,
            bounds: codec::decode("bounds", bounds)?,
            identity: codec::decode("identity", identity)?,
            golden: codec::decode("golden vectors", golden)?,
        };
        policy.validate()?;
        policy.verify()?;
        Ok(policy)
    }
}

/// The sections of a file whose checksums are right.
fn sections(bytes: &[u8]) -> Result<[&[u8]; SECTIONS.len()], FileError> {
    if !bytes.starts_with(&MAGIC) {
        return Err(FileError::Magic);
    }
    if bytes.len() < HEADER_LEN {
        return Err(FileError::Length {
            expected: HEADER_LEN,
            found: bytes.len(),
        });
    }
    if bytes.len() > MAX_LEN {
        return Err(FileError::TooLong { found: bytes.len() });
    }
    let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    // Before the checksum: another version may have another header.
    if number(8) != VERSION {
        return Err(FileError::Version { found: number(8) });
    }
    if crc32(&bytes[..CHECKSUM_AT]) != number(CHECKSUM_AT) {
        return Err(FileError::Header);
    }
    let expected = number(16) as usize;
    if bytes.len() != expected {
        return Err(FileError::Length {
            expected,
            found: bytes.len(),
        });
    }
    let mut rest = &bytes[HEADER_LEN..];
    let mut found = [&bytes[..0]; SECTIONS.len()];
    for (i, (section, tag)) in SECTIONS.into_iter().enumerate() {
        let entry = TABLE_AT + i * ENTRY_LEN;
        let len = number(entry + 4) as usize;
        if bytes[entry..entry + 4] != tag || len > rest.len() {
            return Err(FileError::Table);
        }
        (found[i], rest) = rest.split_at(len);
        if crc32(found[i]) != number(entry + 8) {
            return Err(FileError::Checksum { section });
        }
    }
    if rest.is_empty() && number(12) as usize == SECTIONS.len() {
        Ok(found)
    } else {
        Err(FileError::Table)
    }
}

/// The usual CRC-32 (IEEE 802.3, as in zlib and PNG).
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let (mut value, mut bit) = (byte as u32, 0);
            while bit < 8 {
                value = if value & 1 == 1 {
                    0xEDB8_8320 ^ (value >> 1)
                } else {
                    value >> 1
                };
                bit += 1;
            }
            table[byte] = value;
            byte += 1;
        }
        table
    };
    !bytes
        .iter()
        .fold(!0, |crc, &byte| TABLE[usize::from(crc as u8 ^ byte)] ^ (crc >> 8))
}

#[cfg(test)]
mod tests;
