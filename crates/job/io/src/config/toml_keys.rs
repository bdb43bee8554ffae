//! A table of a TOML file whose keys several types read, each its own: those of one kind, and those that all kinds share.

use super::toml_file::{Message, TomlFile};
use crate::error::InputError;
use serde::de::value::Error as NoValue;
use serde::de::{DeserializeOwned, Deserializer, Error, IgnoredAny, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};
use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// The keys of a table of a list, such as `[[light]]`, that no type has taken yet.
pub(crate) struct TableKeys<'a> {
    file: &'a TomlFile,
    /// Name of the list and position in it.
    path: [String; 2],
    table: DeTable<'a>,
    span: Range<usize>,
    /// The keys that types have taken, given or not.
    taken: Vec<&'static str>,
    /// A description of the table behind the name of an unknown key: ` of a light`.
    of: String,
}

/// Reads a list of tables as an empty one. [`TableKeys::of_list`] reads their keys.
pub(crate) fn read_later<'de, T, D: Deserializer<'de>>(d: D) -> Result<Vec<T>, D::Error> {
    Vec::<BTreeMap<String, IgnoredAny>>::deserialize(d).map(|_| Vec::new())
}

impl<'a> TableKeys<'a> {
    /// The tables of a list of the file.
    pub(crate) fn of_list(file: &'a TomlFile, list: &str) -> Vec<Self> {
        let root = DeTable::parse(file.text()).map(Spanned::into_inner).unwrap_or_default();
        let Some(DeValue::Array(tables)) = root.get(list).map(Spanned::get_ref) else { return Vec::new() };
        let keys = |(i, item): (usize, &Spanned<DeValue<'a>>)| {
            let DeValue::Table(table) = item.get_ref() else { return None };
            let path = [list.to_string(), i.to_string()];
            Some(Self { file, path, table: table.clone(), span: item.span(), taken: Vec::new(), of: String::new() })
        };
        tables.iter().enumerate().filter_map(keys).collect()
    }

    /// The file.
    pub(crate) fn file(&self) -> &'a TomlFile {
        self.file
    }

    /// Is the key given, and not taken yet?
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// Adds to the description of the table in a message about an unknown key.
    pub(crate) fn describe(&mut self, of: impl AsRef<str>) {
        self.of += of.as_ref();
    }

    /// The value of `kind`, one of these.
    pub(crate) fn kind(&mut self, kinds: &[&'static str]) -> Result<Option<&'static str>, InputError> {
        #[derive(Deserialize)]
        struct Kind {
            kind: Option<String>,
        }
        let Some(kind) = self.take::<Kind>(&[])?.kind else { return Ok(None) };
        kinds.iter().copied().find(|known| *known == kind).map(Some).ok_or_else(|| {
            let Message { problem, help, .. } = Message::unknown("value", &kind, kinds);
            self.error("kind", problem, help)
        })
    }

    /// Reads a type from its keys, except those in `without`.
    pub(crate) fn take<T: DeserializeOwned>(&mut self, without: &[&str]) -> Result<T, InputError> {
        let mut own = DeTable::new();
        for name in keys_of::<T>().iter().filter(|name| !without.contains(name)) {
            self.taken.push(name);
            if let Some((key, value)) = self.table.remove_entry(*name) {
                own.insert(key, value);
            }
        }
        self.read(own)
    }

    /// Reads a type, which refuses unknown keys, from all keys that were not taken.
    pub(crate) fn rest<T: DeserializeOwned>(&mut self) -> Result<T, InputError> {
        let own = std::mem::take(&mut self.table);
        self.read(own)
    }

    fn read<T: DeserializeOwned>(&self, table: DeTable<'a>) -> Result<T, InputError> {
        let table = Spanned::new(self.span.clone(), DeValue::Table(table));
        T::deserialize(ValueDeserializer::from(table)).map_err(|e| self.file.refusal(&e, &self.taken, &self.of))
    }

    /// An error about the value of a key.
    pub(crate) fn error(&self, key: &str, problem: impl Into<String>, help: impl Into<String>) -> InputError {
        let [list, position] = &self.path;
        self.file.error_at_key(&[list, position, key], problem, help)
    }
}

/// The keys of a struct that serde reads from a table.
pub fn keys_of<'de, T: Deserialize<'de>>() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    // The deserializer always ends with an error, after it has stored the names.
    let _ = T::deserialize(FieldNames(&mut names));
    names
}

/// A deserializer that stores the names of the fields of a struct and contains no value.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = NoValue;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, NoValue> {
        Err(NoValue::custom("no struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, NoValue> {
        *self.0 = fields;
        Err(NoValue::custom("no value"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}
