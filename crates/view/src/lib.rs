//! `dunkelfeld view`: a render in the browser, behind a camera whose knobs can be turned while it renders.
//!
//! The noise of a sensor is a function of the film. So exposure time, gain, sensor and frame need no new samples: the server
//! exposes the film as it is. A thread renders and publishes copies of its film (`engine`). A frame is
//! computed when a page asks for it (`developed`), so that a page that reads slowly slows nothing.
//!
//! The server listens on the loopback interface. It answers only requests of its own page, reads no file that a request
//! names, and writes only new files in the folders of the scene and of the outputs.

#![forbid(unsafe_code)]

mod ablation;
mod address;
mod desk;
mod developed;
mod engine;
mod fault;
mod hidden_shares;
mod light_films;
mod light_sum;
mod measure;
mod outlook;
mod panics;
mod path;
mod protocol;
mod save;
mod scene_change;
mod scenes;
mod server;
mod shared;
mod snapshot;

pub use crate::address::PageAddress;

use crate::protocol::SourceKind;
use crate::server::{Guard, router};
use crate::shared::{Shared, Subject, lock};
use dunkelfeld::film::Plane;
use dunkelfeld::{Cancel, Error, SavedFilm, Session, read_radiance};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Settings of a view.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ViewOptions {
    /// The address to listen on. On other interfaces than the loopback, the address of the page contains a random token.
    pub listen: SocketAddr,
    /// The folder of the files that the page saves.
    pub output: PathBuf,
    /// Threads of exposures and measurements; 0 means one per core.
    pub threads: usize,
}

impl Default for ViewOptions {
    /// A free port of the loopback interface, and the current folder.
    fn default() -> Self {
        Self { listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0), output: PathBuf::from("."), threads: 0 }
    }
}

/// Shows a scene, a job, a saved film or an EXR until `cancel` ends it. `ready` receives the addresses of the page.
///
/// # Errors
/// An address that cannot be listened on, a film that cannot be read. Faults of a scene appear on the page, which shows
/// the scene when they are mended.
pub fn serve(
    path: &Path,
    options: &ViewOptions,
    cancel: &Cancel,
    ready: impl FnOnce(&PageAddress),
) -> Result<(), Error> {
    let ends_in = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let stored = if ends_in("film") {
        Stored::Film(Box::new(SavedFilm::read(path)?))
    } else if ends_in("exr") {
        Stored::Exr(read_radiance(path)?)
    } else {
        // A file that does not exist is a fault of the command, and no page could mend it.
        std::fs::metadata(path).map_err(|e| {
            let help = "name a scene, a job, a film or an EXR";
            Error::setting("the scene", format!("{} cannot be read: {e}", path.display()), help)
        })?;
        Stored::Scene
    };
    if !options.output.is_dir() {
        let problem = format!("{} is no folder", options.output.display());
        return Err(Error::setting("output", problem, "make it, or choose another one"));
    }
    let kind = match stored {
        Stored::Film(_) => SourceKind::Film,
        Stored::Exr(_) => SourceKind::Exr,
        Stored::Scene => SourceKind::Render,
    };
    let fault = |e: std::io::Error| {
        Error::setting(
            "listen",
            format!("{} cannot be used: {e}", options.listen),
            "choose another port, or 0 for a free one",
        )
    };
    let listener = std::net::TcpListener::bind(options.listen).map_err(fault)?;
    listener.set_nonblocking(true).map_err(fault)?;
    let address = listener.local_addr().map_err(fault)?;
    let token = if address.ip().is_loopback() { None } else { Some(random_token()?) };
    let page = PageAddress::new(address, token.as_deref());
    let subject = Subject { path: path.to_owned(), kind, output: options.output.clone() };
    let (session, background) = (Session::new(options.threads)?, Session::in_background(options.threads)?);
    let shared = Arc::new(Shared::new(subject, session, background));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .max_blocking_threads(8)
        .build()
        .map_err(|e| Error::Threads(e.to_string()))?;
    std::thread::scope(|scope| {
        match stored {
            Stored::Film(saved) => engine::show_film(&shared, *saved),
            Stored::Exr(mean) => engine::show_exr(&shared, path.to_owned(), mean)?,
            Stored::Scene => {
                scope.spawn(|| engine::run(&shared));
                scope.spawn(|| engine::watch_files(&shared));
            }
        }
        scope.spawn(|| engine::analyse(&shared));
        let served = runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(listener)?;
            let app = router(shared.clone(), Guard::new(address, token));
            ready(&page);
            tokio::select! {
                result = async { axum::serve(listener, app).await } => result,
                () = cancelled(cancel) => Ok(()),
            }
        });
        shared.control(|control| control.quit = true);
        // Computations that run end by themselves. Files that are being written become whole.
        runtime.shutdown_timeout(Duration::from_secs(1));
        drop(lock(&shared.writes));
        served.map_err(fault)
    })
}

/// The data of a file that needs no render.
enum Stored {
    Scene,
    Film(Box<SavedFilm>),
    Exr(Plane<[f32; 3]>),
}

async fn cancelled(cancel: &Cancel) {
    while !cancel.is_cancelled() {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// 128 random bits.
fn random_token() -> Result<String, Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)
        .map_err(|e| Error::setting("listen", format!("there are no random numbers: {e}"), "listen on 127.0.0.1"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
