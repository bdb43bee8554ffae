//! The page that shows a data set of rendered images with labels.

mod cost_section;
mod draw_section;
mod draws;
mod label_section;
mod overlay;
mod page;
mod summary;
mod table;
#[cfg(test)]
pub(crate) mod tests;
mod view;

pub(crate) use page::page;
pub(crate) use view::SetView;
