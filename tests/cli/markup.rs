//! Pages of reports as XML.

/// A page of a report as XML: without its document type, and with its void elements closed.
pub(crate) fn as_xml(page: &str) -> String {
    let markup = page.strip_prefix("<!DOCTYPE html>").expect("a document type");
    let is_void = |part: &str| ["meta ", "img ", "input ", "br>"].iter().any(|name| part.starts_with(name));
    let closed = |part: &str| if is_void(part) { part.replacen('>', "/>", 1) } else { part.to_owned() };
    markup.split('<').map(closed).collect::<Vec<_>>().join("<")
}
