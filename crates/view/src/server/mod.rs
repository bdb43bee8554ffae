//! The server of the page: HTTP on the loopback interface.

mod assets;
mod guard;
mod routes;

pub(crate) use guard::Guard;
pub(crate) use routes::router;
