//! The contact sheet and the page that show a data set of rendered images with labels.

mod cost_section;
mod draw_section;
mod draws;
mod error;
#[cfg(test)]
mod fake;
mod font;
mod label_section;
mod overlay;
mod page;
mod picture;
mod sheet;
mod summary;
mod table;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use error::ReportError;
pub(crate) use page::page;
pub(crate) use sheet::{CELL, MOST_IMAGES, contact_sheet};
pub(crate) use view::SetView;
