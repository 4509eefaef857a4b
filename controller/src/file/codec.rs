//! How values lie in a policy file: little-endian, fields in order, no padding. The same list of fields makes the writer
//! and the reader of a type.
//!
//! Numbers as they are, `bool` as one byte, arrays item after item; a list is its length (u32) and its items, a text
//! the same with UTF-8 bytes, an optional value a byte 0 or 1 and then the value if 1. What can be one of several things is
//! a text that says which, then its fields.

use alloc::{string::String, vec::Vec};

use super::FileError;
use crate::{
    actor::{Activation, Actor, Dense, Head},
    golden::{Golden, GoldenAction, GoldenStep},
    layout::BlockLayout,
    policy::{Bounds, Curriculum, Identity},
    spec::*,
    weights::Weights,
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

numbers!(u8, i8, u16, u32, u64, f32);

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

/// Enumerations without fields: a text.
macro_rules! names {
    ($type:ident { $($name:literal => $variant:ident),* }) => {
        impl $type {
            /// Its name in files and configurations.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }
        }

        impl Codec for $type {
            fn write(&self, out: &mut Vec<u8>) {
                String::from(self.name()).write(out);
            }

            fn read(from: &mut Reader) -> Result<Self, FileError> {
                match String::read(from)?.as_str() {
                    $($name => Ok(Self::$variant),)*
                    _ => Err(from.malformed(concat!("unknown name of ", stringify!($type)))),
                }
            }
        }
    };
}

impl Codec for Spec {
    fn write(&self, out: &mut Vec<u8>) {
        self.control_hz.write(out);
        self.joints.write(out);
        self.layout().write(out);
        self.action.write(out);
        self.clock.write(out);
        self.symmetry.write(out);
        self.command.write(out);
        self.legs.write(out);
        self.inertial_frame_period.write(out);
        self.upright.write(out);
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        let control_hz = Codec::read(from)?;
        let joints = Codec::read(from)?;
        let layout: Vec<BlockLayout> = Codec::read(from)?;
        let known = |words: &BlockLayout| Block::ALL.into_iter().find(|block| block.name() == words.name);
        let observation: Option<Vec<Block>> = layout.iter().map(known).collect();
        let spec = Self {
            control_hz,
            joints,
            observation: observation.ok_or_else(|| from.malformed("unknown block of the observation"))?,
            action: Codec::read(from)?,
            clock: Codec::read(from)?,
            symmetry: Codec::read(from)?,
            command: Codec::read(from)?,
            legs: Codec::read(from)?,
            inertial_frame_period: Codec::read(from)?,
            upright: Codec::read(from)?,
        };
        if spec.layout() == layout {
            Ok(spec)
        } else {
            Err(from.malformed("a block of the observation has another length, unit or frame here"))
        }
    }
}

fields!(BlockLayout { name, len, unit, frame });
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
fields!(ClockSpec { period, reset_phase });
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
    latency,
    curriculum
});
fields!(Curriculum {
    lower,
    upper,
    velocity_factor,
    foot_factor
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

names!(ActionLaw {
    "increment_on_measured" => IncrementOnMeasured, "increment_on_target" => IncrementOnTarget,
    "offset_from_nominal" => OffsetFromNominal
});
names!(Activation { "tanh" => Tanh, "elu" => Elu, "relu" => Relu });
names!(Head { "beta" => Beta, "gaussian" => Gaussian });

/// What the file says of when a filter begins: all begin alike.
const FILTER_START: &str = "first_action";

impl Codec for FilterSpec {
    fn write(&self, out: &mut Vec<u8>) {
        let (name, order, value): (&str, u8, f32) = match *self {
            Self::Exponential { gain } => ("exponential", 1, gain),
            Self::Butterworth { cutoff_hz } => ("butterworth", 2, cutoff_hz),
        };
        String::from(name).write(out);
        order.write(out);
        value.write(out);
        String::from(FILTER_START).write(out);
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        let (name, order, value) = (String::read(from)?, u8::read(from)?, f32::read(from)?);
        if String::read(from)? != FILTER_START {
            return Err(from.malformed("filters start at the first action"));
        }
        match (name.as_str(), order) {
            ("exponential", 1) => Ok(Self::Exponential { gain: value }),
            ("butterworth", 2) => Ok(Self::Butterworth { cutoff_hz: value }),
            _ => Err(from.malformed("unknown filter")),
        }
    }
}

impl Codec for Weights {
    fn write(&self, out: &mut Vec<u8>) {
        let name: &str = match self {
            Self::F32(_) => "f32",
            Self::F16(_) => "f16",
            Self::Int8 { .. } => "int8",
        };
        String::from(name).write(out);
        match self {
            Self::F32(weights) => weights.write(out),
            Self::F16(bits) => bits.write(out),
            Self::Int8 { scale, values } => {
                scale.write(out);
                values.write(out);
            }
        }
    }

    fn read(from: &mut Reader) -> Result<Self, FileError> {
        match String::read(from)?.as_str() {
            "f32" => Ok(Self::F32(Codec::read(from)?)),
            "f16" => Ok(Self::F16(Codec::read(from)?)),
            "int8" => Ok(Self::Int8 {
                scale: Codec::read(from)?,
                values: Codec::read(from)?,
            }),
            _ => Err(from.malformed("unknown precision of weights")),
        }
    }
}
