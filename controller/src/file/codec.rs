//! How values lie in a policy file: little-endian, fields in order, no padding. The same list of fields makes the writer
//! and the reader of a type.
//!
//! Numbers as they are, `bool` and tags as one byte, arrays item after item; a list is its length (u32) and its
//! items, a text the same with UTF-8 bytes, an optional value a byte 0 or 1 and then the value if 1.

use alloc::{string::String, vec::Vec};

use super::FileError;
use crate::{
    actor::{Activation, Actor, Dense, Head},
    policy::{Bounds, Golden, GoldenAction, GoldenStep, Identity},
    spec::*,
};

/// A section being read.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    section: &'static str,
}

impl<'a> Reader<'a> {
    fn malformed(&self, problem: &'static str) -> FileError {
        FileError::Malformed {
            section: self.section,
            offset: self.at,
            problem,
        }
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], FileError> {
        let rest = &self.bytes[self.at..];
        if len > rest.len() {
            return Err(self.malformed("more was announced than the section holds"));
        }
        self.at += len;
        Ok(&rest[..len])
    }
}

/// A value in a file.
pub(super) trait Codec: Sized {
    fn write(&self, out: &mut Vec<u8>);
    fn read(from: &mut Reader) -> Result<Self, FileError>;
}

/// The bytes of a section.
pub(super) fn encode<T: Codec>(value: &T) -> Vec<u8> {
    let mut bytes = Vec::new();
    value.write(&mut bytes);
    bytes
}

/// The value of a section, which must be all of it.
pub(super) fn decode<T: Codec>(section: &'static str, bytes: &[u8]) -> Result<T, FileError> {
    let mut reader = Reader { bytes, at: 0, section };
    let value = T::read(&mut reader)?;
    if reader.at == bytes.len() {
        Ok(value)
    } else {
        Err(reader.malformed("bytes are left over"))
    }
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Codec for $number {
            fn write(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn read(from: &mut Reader) -> Result<Self, FileError> {
                let mut bytes = [0; size_of::<$number>()];
                bytes.copy_from_slice(from.take(size_of::<$number>())?);
                Ok(<$number>::from_le_bytes(bytes))
            }
        }
    )*};
}

numbers!(u8, u16, u32, u64, f32);

impl Codec for bool {
    fn write(&self, out: &mut Vec<u8>) {
        u8::from(*self).write(out);
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        match u8::read(from)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(from.malformed("a truth value is 0 or 1")),
        }
    }
}

impl<T: Codec + Copy + Default, const N: usize> Codec for [T; N] {
    fn write(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|item| item.write(out));
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        let mut items = [T::default(); N];
        for item in &mut items {
            *item = T::read(from)?;
        }
        Ok(items)
    }
}

impl<T: Codec> Codec for Vec<T> {
    fn write(&self, out: &mut Vec<u8>) {
        (self.len() as u32).write(out);
        self.iter().for_each(|item| item.write(out));
    }

    /// Grows with what has been read: a length that lies costs nothing.
    fn read(from: &mut Reader) -> Result<Self, FileError> {
        let len = u32::read(from)? as usize;
        if len > from.bytes.len() - from.at {
            return Err(from.malformed("a list is longer than the section"));
        }
        let mut items = Vec::new();
        for _ in 0..len {
            items.push(T::read(from)?);
        }
        Ok(items)
    }
}

impl Codec for String {
    fn write(&self, out: &mut Vec<u8>) {
        (self.len() as u32).write(out);
        out.extend_from_slice(self.as_bytes());
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        let len = u32::read(from)? as usize;
        let bytes = from.take(len)?;
        core::str::from_utf8(bytes)
            .map(Self::from)
            .map_err(|_| from.malformed("a text is not UTF-8"))
    }
}

impl<T: Codec> Codec for Option<T> {
    fn write(&self, out: &mut Vec<u8>) {
        self.is_some().write(out);
        if let Some(value) = self {
            value.write(out);
        }
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        bool::read(from)?.then(|| T::read(from)).transpose()
    }
}

/// A layer's inputs fit a u32 by [`crate::Actor::validate`] and the bounds of a file.
impl Codec for usize {
    fn write(&self, out: &mut Vec<u8>) {
        (*self as u32).write(out);
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        Ok(u32::read(from)? as usize)
    }
}

macro_rules! fields {
    ($type:ident { $($field:ident),* }) => {
        impl Codec for $type {
            fn write(&self, out: &mut Vec<u8>) {
                $(self.$field.write(out);)*
            }

            fn read(from: &mut Reader) -> Result<Self, FileError> {
                Ok(Self { $($field: Codec::read(from)?),* })
            }
        }
    };
}

/// Enumerations: a tag, then the fields of the variant.
macro_rules! tags {
    ($type:ident { $($tag:literal => $variant:ident $({ $field:ident })?),* }) => {
        impl Codec for $type {
            fn write(&self, out: &mut Vec<u8>) {
                match self {
                    $(Self::$variant $({ $field })? => {
                        out.push($tag);
                        $($field.write(out);)?
                    })*
                }
            }

            fn read(from: &mut Reader) -> Result<Self, FileError> {
                match u8::read(from)? {
                    $($tag => Ok(Self::$variant $({ $field: Codec::read(from)? })?),)*
                    _ => Err(from.malformed(concat!("unknown tag of ", stringify!($type)))),
                }
            }
        }
    };
}

fields!(Spec {
    control_hz,
    joints,
    observation,
    action,
    clock,
    symmetry,
    command,
    legs,
    inertial_frame_period
});
fields!(JointSpec {
    name,
    nominal,
    lower,
    upper,
    kp,
    kd,
    torque_limit,
    action_scale
});
fields!(ActionSpec {
    law,
    filter,
    torque_clamp
});
fields!(ClockSpec { period });
fields!(MirroredJoint { joint, sign });
fields!(CommandSpec { rate, lower, upper });
fields!(Leg {
    name,
    segments,
    corners,
    sole_rotation
});
fields!(Segment {
    translation,
    rotation,
    axis,
    prismatic,
    joint,
    multiplier,
    offset
});
fields!(Actor {
    mean,
    deviation,
    clip,
    activation,
    head,
    layers
});
fields!(Dense { inputs, weights, bias });
fields!(Bounds { lower, upper });
fields!(Identity {
    config_hash,
    seed,
    steps,
    program,
    latency
});
fields!(Golden {
    actions,
    clock_phase,
    steps
});
fields!(GoldenAction { observation, action });
fields!(GoldenStep {
    position,
    velocity,
    attitude,
    gyro,
    base_velocity,
    desired,
    observation,
    targets
});

tags!(Block {
    0 => JointPosition, 1 => JointVelocity, 2 => Attitude, 3 => Gyro, 4 => VelocityInertial, 5 => VelocityBase,
    6 => DesiredVelocity, 7 => CommandedVelocity, 8 => Clock, 9 => PreviousTarget
});
tags!(ActionLaw { 0 => IncrementOnMeasured, 1 => IncrementOnTarget, 2 => OffsetFromNominal });
tags!(FilterSpec { 0 => Exponential { gain }, 1 => Butterworth { cutoff_hz } });
tags!(Activation { 0 => Tanh, 1 => Elu, 2 => Relu });
tags!(Head { 0 => Beta, 1 => Gaussian });
