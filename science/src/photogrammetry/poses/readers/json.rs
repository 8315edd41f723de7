//! What the JSON formats share: numbers that may be text, and lists of bounded length.

use std::fmt;

use serde::{
    Deserialize, Deserializer,
    de::{self, DeserializeOwned, SeqAccess, Visitor},
};

use crate::{
    photogrammetry::poses::{MAX_VIEWS, invalid},
    types::Error,
};

/// A number that is written as a number or as text: the property tree of Boost writes all values as text.
#[derive(Debug, Clone, Copy)]
pub(super) struct Number(pub(super) f64);

/// An id that is written as a number or as text.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Id(pub(super) String);

struct NumberVisitor<const LISTS: bool>;

impl<'de, const LISTS: bool> Visitor<'de> for NumberVisitor<LISTS> {
    type Value = Number;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number")
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Number, E> {
        Ok(Number(value))
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Number, E> {
        Ok(Number(value as f64))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Number, E> {
        Ok(Number(value as f64))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Number, E> {
        text.trim().parse().map(Number).map_err(|_| E::invalid_value(de::Unexpected::Str(text), &self))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Number, A::Error> {
        if !LISTS {
            return Err(de::Error::invalid_type(de::Unexpected::Seq, &self));
        }
        let (mut sum, mut count) = (0.0, 0.0);
        while let Some(Number(value)) = list.next_element()? {
            (sum, count) = (sum + value, count + 1.0);
        }
        Ok(Number(sum / count))
    }
}

/// A focal length, or the mean of those of both axes.
pub(super) fn mean<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Number>, D::Error> {
    deserializer.deserialize_any(NumberVisitor::<true>).map(Some)
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumberVisitor::<false>)
    }
}

struct IdVisitor;

impl Visitor<'_> for IdVisitor {
    type Value = Id;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an id")
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Id, E> {
        Ok(Id(value.to_string()))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Id, E> {
        Ok(Id(value.to_string()))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Id, E> {
        Ok(Id(text.trim().to_owned()))
    }
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(IdVisitor)
    }
}

/// A list of at most [`MAX_VIEWS`] elements, read one by one: a longer one costs no memory.
pub(super) fn bounded<'de, D, T>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    struct List<T>(std::marker::PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for List<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of at most {MAX_VIEWS} elements")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Vec<T>, A::Error> {
            let mut list = Vec::new();
            while let Some(element) = elements.next_element()? {
                if list.len() == MAX_VIEWS {
                    return Err(de::Error::custom(format!("more than {MAX_VIEWS} elements")));
                }
                list.push(element);
            }
            Ok(list)
        }

        // the property tree of Boost writes an empty list as ""
        fn visit_str<E: de::Error>(self, text: &str) -> Result<Vec<T>, E> {
            if text.is_empty() { Ok(Vec::new()) } else { Err(E::invalid_type(de::Unexpected::Str(text), &self)) }
        }
    }

    deserializer.deserialize_any(List(std::marker::PhantomData))
}

/// Parses the file of `program`.
pub(super) fn parse<T: DeserializeOwned>(text: &str, program: &str) -> Result<T, Error> {
    serde_json::from_str(text).map_err(|error| invalid(format!("the file is not a {program}: {error}")))
}

/// Three rows of nine numbers.
pub(super) fn rows([a, b, c, d, e, f, g, h, i]: [Number; 9]) -> [[f64; 3]; 3] {
    [[a.0, b.0, c.0], [d.0, e.0, f.0], [g.0, h.0, i.0]]
}

/// The rows of the transposed matrix.
pub(super) fn transposed(rows: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|column| rows.map(|row| row[column]))
}
