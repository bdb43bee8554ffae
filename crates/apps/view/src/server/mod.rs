//! The server of the page: HTTP on the loopback interface.

mod assets;
mod guard;
mod routes;

pub(crate) use guard::Guard;
pub(crate) use routes::router;

use axum::Router;
use axum::serve::Listener;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use std::time::Duration;

/// The head of a request, and its body, must arrive within this time. So long may a connection be without requests, too.
const ARRIVES_WITHIN: Duration = Duration::from_secs(10);

/// Answers the requests of all connections. It never ends by itself.
pub(crate) async fn serve(mut listener: tokio::net::TcpListener, app: Router) {
    loop {
        // An error is waited out: one of too many files ends with other connections.
        let (stream, _) = Listener::accept(&mut listener).await;
        let service = TowerToHyperService::new(app.clone());
        tokio::spawn(async move {
            let mut builder = Builder::new(TokioExecutor::new()).http1_only();
            builder.http1().timer(TokioTimer::new()).header_read_timeout(ARRIVES_WITHIN);
            // A connection that breaks is closed, and nobody is left to be told.
            drop(builder.serve_connection(TokioIo::new(stream), service).await);
        });
    }
}
