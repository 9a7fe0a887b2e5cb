//! Results serialised to bytes and restored bit by bit, so that a run can continue where another one stopped.
//!
//! A struct is stored as its fields in the order of its list, an enum as the name of its variant followed by the
//! variant's value. There is no version in the bytes: only the program that wrote them may read them.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

/// A value that can be stored as bytes and restored bit by bit.
pub trait Stored: Sized {
    /// Appends the value to `bytes`.
    fn store(&self, bytes: &mut Vec<u8>);

    /// Takes a value off the front of `bytes`; `None` if they do not begin with such a value.
    fn restore(bytes: &mut &[u8]) -> Option<Self>;
}

/// Implements [`Stored`] for a struct by the list of its fields, or for an enum by that of its variants, each
/// with at most one value: `stored!(struct Score { value, sigma })`,
/// `stored!(enum Against { Reference, Scanner(name) })`.
#[doc(hidden)]
#[macro_export]
macro_rules! __stored {
    (struct $name:ident { $($field:ident),* $(,)? }) => {
        impl $crate::stored::Stored for $name {
            fn store(&self, bytes: &mut Vec<u8>) {
                $($crate::stored::Stored::store(&self.$field, bytes);)*
            }

            fn restore(bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: $crate::stored::Stored::restore(bytes)?,)* })
            }
        }
    };
    (enum $name:ident { $($variant:ident $(($value:ident))?),* $(,)? }) => {
        impl $crate::stored::Stored for $name {
            fn store(&self, bytes: &mut Vec<u8>) {
                match self {
                    $(Self::$variant $(($value))? => {
                        $crate::stored::Stored::store(&stringify!($variant), bytes);
                        $($crate::stored::Stored::store($value, bytes);)?
                    })*
                }
            }

            fn restore(bytes: &mut &[u8]) -> Option<Self> {
                let name: String = $crate::stored::Stored::restore(bytes)?;
                match name.as_str() {
                    $(stringify!($variant) => Some(Self::$variant $(({
                        let $value = $crate::stored::Stored::restore(bytes)?;
                        $value
                    }))?),)*
                    _ => None,
                }
            }
        }
    };
}
pub use crate::__stored as stored;

/// Numbers, as their bytes in little-endian order.
macro_rules! stored_number {
    ($($number:ty),*) => {$(
        impl Stored for $number {
            fn store(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn restore(bytes: &mut &[u8]) -> Option<Self> {
                let (number, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_le_bytes(*number))
            }
        }
    )*};
}
stored_number!(u8, u16, u32, u64, u128, i32, f32, f64);

impl Stored for usize {
    fn store(&self, bytes: &mut Vec<u8>) {
        (*self as u64).store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        Self::try_from(u64::restore(bytes)?).ok()
    }
}

impl Stored for bool {
    fn store(&self, bytes: &mut Vec<u8>) {
        u8::from(*self).store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        match u8::restore(bytes)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

fn store_text(text: &str, bytes: &mut Vec<u8>) {
    text.len().store(bytes);
    bytes.extend_from_slice(text.as_bytes());
}

impl Stored for String {
    fn store(&self, bytes: &mut Vec<u8>) {
        store_text(self, bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        let length = usize::restore(bytes)?;
        let (text, rest) = bytes.split_at_checked(length)?;
        *bytes = rest;
        Self::from_utf8(text.to_vec()).ok()
    }
}

/// For the few names that the program itself defines, such as units: each restored name stays in memory once, until
/// the program ends.
impl Stored for &'static str {
    fn store(&self, bytes: &mut Vec<u8>) {
        store_text(self, bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
        let name = String::restore(bytes)?;
        let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
        let known = names.get(name.as_str()).copied();
        Some(known.unwrap_or_else(|| {
            let leaked: &'static str = name.leak();
            names.insert(leaked);
            leaked
        }))
    }
}

impl<T: Stored> Stored for Option<T> {
    fn store(&self, bytes: &mut Vec<u8>) {
        self.is_some().store(bytes);
        if let Some(value) = self {
            value.store(bytes);
        }
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        if bool::restore(bytes)? {
            Some(Some(T::restore(bytes)?))
        } else {
            Some(None)
        }
    }
}

/// Appends values as a `Vec` of them would be stored.
pub fn store_all<T: Stored>(values: &[T], bytes: &mut Vec<u8>) {
    values.len().store(bytes);
    values.iter().for_each(|value| value.store(bytes));
}

impl<T: Stored> Stored for Vec<T> {
    fn store(&self, bytes: &mut Vec<u8>) {
        store_all(self, bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        let length = usize::restore(bytes)?;
        // Whatever length the bytes claim, reserve no more memory than they can fill.
        let mut values = Self::with_capacity(length.min(bytes.len() / size_of::<T>().max(1)));
        for _ in 0..length {
            values.push(T::restore(bytes)?);
        }
        Some(values)
    }
}

impl<T: Stored + Default, const N: usize> Stored for [T; N] {
    fn store(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|value| value.store(bytes));
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        let mut is_complete = true;
        let values = std::array::from_fn(|_| {
            let value = T::restore(bytes);
            is_complete &= value.is_some();
            value.unwrap_or_default()
        });
        is_complete.then_some(values)
    }
}

impl Stored for () {
    fn store(&self, _bytes: &mut Vec<u8>) {}

    fn restore(_bytes: &mut &[u8]) -> Option<Self> {
        Some(())
    }
}

impl<A: Stored, B: Stored> Stored for (A, B) {
    fn store(&self, bytes: &mut Vec<u8>) {
        self.0.store(bytes);
        self.1.store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        Some((A::restore(bytes)?, B::restore(bytes)?))
    }
}

impl Stored for Vector3<f64> {
    fn store(&self, bytes: &mut Vec<u8>) {
        <[f64; 3]>::from(*self).store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        Some(<[f64; 3]>::restore(bytes)?.into())
    }
}

/// Stored as it is, because normalising it again could change its last bits.
impl Stored for UnitQuaternion<f64> {
    fn store(&self, bytes: &mut Vec<u8>) {
        <[f64; 4]>::from(self.coords).store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        let coordinates = <[f64; 4]>::restore(bytes)?;
        Some(Self::new_unchecked(coordinates.into()))
    }
}

impl Stored for DVector<f64> {
    fn store(&self, bytes: &mut Vec<u8>) {
        store_all(self.as_slice(), bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        Some(Self::from_vec(Vec::restore(bytes)?))
    }
}

impl Stored for DMatrix<f64> {
    fn store(&self, bytes: &mut Vec<u8>) {
        self.shape().store(bytes);
        store_all(self.as_slice(), bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        let (rows, columns) = <(usize, usize)>::restore(bytes)?;
        let values: Vec<f64> = Vec::restore(bytes)?;
        let is_complete = rows.checked_mul(columns) == Some(values.len());
        is_complete.then(|| Self::from_vec(rows, columns, values))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[derive(Debug, PartialEq)]
    enum Kind {
        Plain,
        Named(String),
    }
    stored!(
        enum Kind {
            Plain,
            Named(name),
        }
    );

    /// One field of each kind.
    #[derive(Debug, PartialEq)]
    struct Value {
        kinds: Vec<Kind>,
        unit: &'static str,
        missing: Option<f64>,
        pairs: Vec<(usize, [f32; 2])>,
        place: Vector3<f64>,
        turn: UnitQuaternion<f64>,
        row: DVector<f64>,
        table: DMatrix<f64>,
        is_last: bool,
    }
    stored!(struct Value { kinds, unit, missing, pairs, place, turn, row, table, is_last });

    fn value() -> Value {
        Value {
            kinds: vec![Kind::Named("left".into()), Kind::Plain],
            unit: "mm",
            missing: None,
            pairs: vec![(7, [0.1, -0.0])],
            place: Vector3::new(1e-300, f64::NEG_INFINITY, 0.1 + 0.2),
            turn: UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
            row: DVector::from_vec(vec![1.0, 2.0]),
            table: DMatrix::from_fn(2, 3, |i, j| (i + 10 * j) as f64),
            is_last: true,
        }
    }

    fn bytes_of(value: &impl Stored) -> Vec<u8> {
        let mut bytes = Vec::new();
        value.store(&mut bytes);
        bytes
    }

    #[test]
    fn values_come_back_bit_by_bit() {
        let bytes = bytes_of(&value());
        let mut rest = bytes.as_slice();
        let found = Value::restore(&mut rest).unwrap();
        assert_eq!((&found, rest), (&value(), &[][..]));
        assert_eq!(bytes_of(&found), bytes);
        // Comparison with == cannot distinguish these.
        for special in [-0.0, f64::from_bits(0x7ff8_0000_dead_beef)] {
            let found = f64::restore(&mut bytes_of(&special).as_slice()).unwrap();
            assert_eq!(found.to_bits(), special.to_bits());
        }
    }

    #[test]
    fn invalid_bytes_restore_no_value() {
        let bytes = bytes_of(&value());
        for length in 0..bytes.len() {
            assert_eq!(
                Value::restore(&mut &bytes[..length]),
                None,
                "{length} bytes"
            );
        }
        // Damaged bytes cause neither a panic nor a huge allocation.
        let random = &mut ChaCha8Rng::seed_from_u64(1);
        for _ in 0..10_000 {
            let mut bytes = bytes.clone();
            for _ in 0..random.random_range(1..4) {
                let place = random.random_range(0..bytes.len());
                bytes[place] = random.random();
            }
            let _ = Value::restore(&mut bytes.as_slice());
        }
        let too_few = bytes_of(&((3usize, 2usize), vec![1.0; 4]));
        assert_eq!(DMatrix::restore(&mut too_few.as_slice()), None);
    }
}
