//! The parts of reports: charts, maps, tables and the frame of a page that needs no other file. Each report adds its
//! own sections. This module does not depend on their content.

pub(crate) mod chart;
pub(crate) mod estimate;
pub(crate) mod maps;
pub(crate) mod page;
pub(crate) mod table;
pub(crate) mod words;
