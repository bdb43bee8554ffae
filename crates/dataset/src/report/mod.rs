//! The contact sheet and the page that show a data set of rendered images with labels.

mod bins;
mod chart;
mod cost_section;
mod draw_section;
mod draws;
mod error;
#[cfg(test)]
mod fake;
mod font;
mod frame;
mod label_section;
mod overlay;
mod page;
mod picture;
mod sheet;
#[cfg(test)]
mod tests;
mod view;
mod words;

pub(crate) use error::ReportError;
pub(crate) use page::page;
pub(crate) use sheet::{SheetOptions, contact_sheet};
pub(crate) use view::SetView;
