//! Tensors of a checkpoint.

use std::borrow::Cow;

use safetensors::tensor::{Dtype, View};

/// The elements of a tensor.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Data {
    F32(Vec<f32>),
    F64(Vec<f64>),
    U64(Vec<u64>),
    U8(Vec<u8>),
}

/// A type that tensors are made of.
pub trait Element: Sized + Copy {
    /// Name of the type in messages.
    const NAME: &'static str;
    /// Wraps elements.
    fn wrap(values: Vec<Self>) -> Data;
    /// The elements, if they are of this type.
    fn unwrap(data: &Data) -> Option<&[Self]>;
}

macro_rules! element {
    ($type:ty, $variant:ident) => {
        impl Element for $type {
            const NAME: &'static str = stringify!($type);
            fn wrap(values: Vec<Self>) -> Data {
                Data::$variant(values)
            }
            fn unwrap(data: &Data) -> Option<&[Self]> {
                match data {
                    Data::$variant(values) => Some(values),
                    _ => None,
                }
            }
        }
    };
}
element!(f32, F32);
element!(f64, F64);
element!(u64, U64);
element!(u8, U8);

impl Data {
    /// Name of the element type.
    pub fn kind(&self) -> &'static str {
        match self {
            Data::F32(_) => f32::NAME,
            Data::F64(_) => f64::NAME,
            Data::U64(_) => u64::NAME,
            Data::U8(_) => u8::NAME,
        }
    }

    pub(super) fn dtype(&self) -> Dtype {
        match self {
            Data::F32(_) => Dtype::F32,
            Data::F64(_) => Dtype::F64,
            Data::U64(_) => Dtype::U64,
            Data::U8(_) => Dtype::U8,
        }
    }

    pub(super) fn to_bytes(&self) -> Cow<'_, [u8]> {
        match self {
            Data::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Data::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Data::U64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Data::U8(values) => Cow::Borrowed(values),
        }
    }

    pub(super) fn from_bytes(dtype: Dtype, bytes: &[u8]) -> Option<Self> {
        Some(match dtype {
            Dtype::F32 => Data::F32(words(bytes, f32::from_le_bytes)),
            Dtype::F64 => Data::F64(words(bytes, f64::from_le_bytes)),
            Dtype::U64 => Data::U64(words(bytes, u64::from_le_bytes)),
            Dtype::U8 => Data::U8(bytes.to_vec()),
            _ => return None,
        })
    }
}

fn words<const N: usize, T>(bytes: &[u8], decode: fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks().0.iter().map(|word| decode(*word)).collect()
}

/// Elements and their shape, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Sizes of the dimensions, slowest first.
    pub shape: Vec<usize>,
    /// The elements; as many as the product of `shape`.
    pub data: Data,
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        self.data.dtype()
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        self.data.to_bytes()
    }
    fn data_len(&self) -> usize {
        self.shape.iter().product::<usize>() * self.data.dtype().bitsize() / 8
    }
}
