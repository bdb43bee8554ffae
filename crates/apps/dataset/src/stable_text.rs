//! The text of a study without what depends on its place, for hashes.

use crate::record::FileRecord;
use toml::{Table, Value};

/// XXH3 of [`stable_text`].
pub(crate) fn text_hash(text: &str, name: &str) -> String {
    FileRecord::of(stable_text(text, name).as_bytes()).hash
}

/// The keys and values of a study of a name, without what depends on its place: comments and `folder`. Those of
/// `study.toml` of a set are the same.
pub(crate) fn stable_text(text: &str, name: &str) -> String {
    let stable = text.parse::<Table>().ok().and_then(|mut keys| {
        let study = keys.get_mut("study").and_then(Value::as_table_mut)?;
        study.remove("folder");
        // The name may be in the text or not.
        let own = study.remove("name").and_then(|name| name.as_str().map(str::to_owned));
        let name = own.unwrap_or_else(|| name.to_owned());
        Some(format!("{name}\n{}", toml::to_string(&keys).ok()?))
    });
    stable.unwrap_or_else(|| text.to_owned())
}
