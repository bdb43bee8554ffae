//! The parts of reports that only studies have: estimates, maps, tables that are also files, and their page. Each report
//! adds its own sections. This module does not depend on their content.

pub(crate) mod estimate;
pub(crate) mod maps;
pub(crate) mod page;
pub(crate) mod table;
