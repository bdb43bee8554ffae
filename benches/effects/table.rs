//! Measured costs, as tables in Markdown, and their place in a page.

use std::fmt::Write;

/// The lines of a page between which the tables stand.
pub(crate) const BEGIN: &str = "<!-- prices: written by `cargo bench -p dunkelfeld-integrator --bench effects` -->";
/// See [`BEGIN`].
pub(crate) const END: &str = "<!-- end of prices -->";

/// One line of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    /// The effects in use.
    pub(crate) name: String,
    /// Instructions per sample.
    pub(crate) instructions: f64,
    /// Its baseline: instructions per sample.
    pub(crate) against: f64,
    /// Is the image the same to the last bit?
    pub(crate) same_image: bool,
}

impl Row {
    /// Its additional cost, in per cent.
    pub(crate) fn percent(&self) -> f64 {
        100.0 * (self.instructions / self.against - 1.0)
    }
}

/// A table of rows.
pub(crate) fn markdown(rows: &[Row]) -> String {
    let mut text = String::from("| effect | instructions per sample | price | same image |\n");
    text += "|---|---:|---:|---|\n";
    for row in rows {
        let same = if row.same_image { "to the last bit" } else { "up to noise" };
        let _ = writeln!(text, "| `{}` | {:.0} | {:+.1} % | {same} |", row.name, row.instructions, row.percent());
    }
    text
}

/// A page with what stands between [`BEGIN`] and [`END`] replaced.
pub(crate) fn replaced(page: &str, tables: &str) -> Result<String, String> {
    let parts = page.split_once(BEGIN).and_then(|(head, rest)| Some((head, rest.split_once(END)?.1)));
    let (head, tail) = parts.ok_or_else(|| {
        format!("there is no place for the table; help: write the lines\n{BEGIN}\n{END}\nwhere it shall stand")
    })?;
    Ok(format!("{head}{BEGIN}\n\n{}\n\n{END}{tail}", tables.trim()))
}
