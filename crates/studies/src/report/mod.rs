//! What reports are made of: charts, maps, tables and the frame of a page that stands alone. Each report brings its own
//! sections; nothing here knows what they are about.

pub(crate) mod chart;
pub(crate) mod estimate;
pub(crate) mod maps;
pub(crate) mod page;
pub(crate) mod table;
pub(crate) mod words;
