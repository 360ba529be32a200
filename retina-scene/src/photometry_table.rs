//! A body's `photometry` table as it stands in the file. Its keys are those of the registered laws and phase functions.

use std::fmt;
use std::marker::PhantomData;
use std::sync::LazyLock;

use retina_radiometry::{Key, Kind, Law, PhaseFunction, Registered};
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};

/// `photometry`: flat, so that an unknown key is still pointed at. Which key belongs to which law is checked afterwards.
#[derive(Debug)]
pub struct PhotometryTable {
    pub(crate) law: Choice<Law>,
    pub(crate) normal_albedo: Option<f64>,
    pub(crate) phase_function: Option<Choice<PhaseFunction>>,
}

/// One of a register, and the keys that are given.
#[derive(Debug)]
pub(crate) struct Choice<T: 'static> {
    pub(crate) kind: &'static Kind<T>,
    given: Vec<(&'static Key, Vec<f64>)>,
}

impl<T> Choice<T> {
    /// The numbers of a key, if it is given.
    pub(crate) fn get(&self, key: &Key) -> Option<&[f64]> {
        self.given.iter().find(|(given, _)| given.name == key.name).map(|(_, values)| values.as_slice())
    }

    /// The first given key that belongs to others, in the order of the register.
    pub(crate) fn foreign(&self) -> Option<&'static str>
    where
        T: Registered,
    {
        let own = |name: &str| self.kind.keys.iter().any(|key| key.name == name);
        let is_given = |key: &Key| self.get(key).is_some();
        T::ALL
            .iter()
            .flat_map(|kind| kind.keys)
            .find(|key| is_given(key) && !own(key.name))
            .map(|key| key.name)
    }
}

/// The key of a table that names one of a register.
const MODEL: &str = "model";
const KIND: &str = "kind";
const NORMAL_ALBEDO: &str = "normal_albedo";
const PHASE_FUNCTION: &str = "phase_function";

static LAW_KEYS: LazyLock<Vec<&'static str>> =
    LazyLock::new(|| keys::<Law>(&[MODEL, NORMAL_ALBEDO, PHASE_FUNCTION]));
static PHASE_KEYS: LazyLock<Vec<&'static str>> = LazyLock::new(|| keys::<PhaseFunction>(&[KIND]));
static LAW_NAMES: LazyLock<Vec<&'static str>> = LazyLock::new(names::<Law>);
static PHASE_NAMES: LazyLock<Vec<&'static str>> = LazyLock::new(names::<PhaseFunction>);

/// The keys that a table may have, each once.
fn keys<T: Registered>(own: &[&'static str]) -> Vec<&'static str> {
    let mut out = own.to_vec();
    for key in T::ALL.iter().flat_map(|kind| kind.keys) {
        if !out.contains(&key.name) {
            out.push(key.name);
        }
    }
    out
}

fn names<T: Registered>() -> Vec<&'static str> {
    T::ALL.iter().map(|kind| kind.name).collect()
}

/// One of the texts that are allowed; serde's own words for another, so that the nearest is suggested.
#[derive(Clone, Copy)]
struct OneOf {
    allowed: &'static [&'static str],
    /// A key, not a name.
    is_key: bool,
}

impl<'de> DeserializeSeed<'de> for OneOf {
    type Value = &'static str;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_str(self)
    }
}

impl Visitor<'_> for OneOf {
    type Value = &'static str;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        write!(formatter, "one of {}", self.allowed.join(", "))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        self.allowed.iter().find(|allowed| **allowed == text).copied().ok_or_else(|| {
            if self.is_key {
                E::unknown_field(text, self.allowed)
            } else {
                E::unknown_variant(text, self.allowed)
            }
        })
    }
}

/// A list of this many numbers.
struct Numbers(usize);

impl<'de> DeserializeSeed<'de> for Numbers {
    type Value = Vec<f64>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Numbers {
    type Value = Vec<f64>;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        write!(formatter, "an array of length {}", self.0)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut out = Vec::with_capacity(self.0);
        while let Some(value) = list.next_element()? {
            out.push(value);
        }
        if out.len() == self.0 { Ok(out) } else { Err(A::Error::invalid_length(out.len(), &self)) }
    }
}

/// What a table gives so far: the name of its kind, and the numbers of keys.
struct Reading<T: 'static> {
    selector: &'static str,
    names: &'static [&'static str],
    name: Option<&'static str>,
    given: Vec<(&'static Key, Vec<f64>)>,
    register: PhantomData<T>,
}

impl<T: Registered> Reading<T> {
    fn new(selector: &'static str, names: &'static [&'static str]) -> Self {
        Self { selector, names, name: None, given: Vec::new(), register: PhantomData }
    }

    /// Takes the value of a key that is the selector or a registered one.
    fn take<'de, A: MapAccess<'de>>(&mut self, name: &'static str, map: &mut A) -> Result<(), A::Error> {
        if name == self.selector {
            self.name = Some(map.next_value_seed(OneOf { allowed: self.names, is_key: false })?);
        } else if let Some(key) = T::ALL.iter().flat_map(|kind| kind.keys).find(|key| key.name == name) {
            let values = if key.length == 1 {
                vec![map.next_value()?]
            } else {
                map.next_value_seed(Numbers(key.length))?
            };
            self.given.push((key, values));
        }
        Ok(())
    }

    fn finish<E: Error>(self) -> Result<Choice<T>, E> {
        let kind = T::ALL.iter().find(|kind| Some(kind.name) == self.name);
        let kind = kind.ok_or_else(|| E::missing_field(self.selector))?;
        Ok(Choice { kind, given: self.given })
    }
}

struct PhotometryVisitor;

impl<'de> Visitor<'de> for PhotometryVisitor {
    type Value = PhotometryTable;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("struct PhotometryTable")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut reading = Reading::new(MODEL, LAW_NAMES.as_slice());
        let (mut normal_albedo, mut phase_function) = (None, None);
        while let Some(name) = map.next_key_seed(OneOf { allowed: LAW_KEYS.as_slice(), is_key: true })? {
            match name {
                NORMAL_ALBEDO => normal_albedo = Some(map.next_value()?),
                PHASE_FUNCTION => phase_function = Some(map.next_value()?),
                name => reading.take(name, &mut map)?,
            }
        }
        Ok(PhotometryTable { law: reading.finish()?, normal_albedo, phase_function })
    }
}

impl<'de> serde::Deserialize<'de> for PhotometryTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("PhotometryTable", LAW_KEYS.as_slice(), PhotometryVisitor)
    }
}

struct PhaseFunctionVisitor;

impl<'de> Visitor<'de> for PhaseFunctionVisitor {
    type Value = Choice<PhaseFunction>;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("struct PhaseFunctionTable")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut reading = Reading::new(KIND, PHASE_NAMES.as_slice());
        while let Some(name) = map.next_key_seed(OneOf { allowed: PHASE_KEYS.as_slice(), is_key: true })? {
            reading.take(name, &mut map)?;
        }
        reading.finish()
    }
}

impl<'de> serde::Deserialize<'de> for Choice<PhaseFunction> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("PhaseFunctionTable", PHASE_KEYS.as_slice(), PhaseFunctionVisitor)
    }
}
