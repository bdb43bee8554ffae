//! `dunkelfeld view`: a render in the browser, behind a camera whose knobs can be turned while it renders.
//!
//! The noise of a sensor is a function of the film. So exposure time, gain, sensor and frame need no new samples: the server
//! exposes the film as it is. A thread renders and publishes copies of its film (`engine`). A frame is
//! computed when a page asks for it (`developed`), so that a page that reads slowly slows nothing.
//!
//! The server listens on the loopback interface. It answers only requests of its own page, reads no file that a request
//! names, and writes only new files in the folders of the scene and of the outputs.

#![forbid(unsafe_code)]

mod address;
mod analysis;
mod desk;
mod developed;
mod engine;
mod fault;
mod locks;
mod measure;
mod outlook;
mod panics;
mod path;
mod prepared;
mod protocol;
mod protocol_measurements;
mod save;
mod saved_job;
mod scene_change;
mod server;
mod shared;
mod snapshot;
mod statistics;
mod store;

pub use crate::address::PageAddress;

use crate::protocol::SourceKind;
use crate::server::{Guard, router};
use crate::shared::{Shared, Subject, lock};
use dunkelfeld::outputs::ExrImage;
use dunkelfeld::{Cancel, Error, ExposeOptions, Project, SavedFilm, Session};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// The endings of scenes and jobs.
const SCENES: [&str; 6] = ["gltf", "glb", "obj", "stl", "ply", "toml"];

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
    /// Nice value of the threads of the render and of the analyses, 0 to 19: with a larger one, other programs get more time.
    pub nice: u8,
    /// The lens behind which an EXR is exposed; by default that of its render, or of
    /// [`dunkelfeld::ExposeSettings::new`].
    pub image: ExposeOptions,
}

/// Receives the events of a view that a terminal shows.
pub trait ViewEvents {
    /// The page can be opened.
    fn ready(&mut self, address: &PageAddress);

    /// A scene cannot be shown, with the reason. The page shows it too, and the view goes on.
    fn failed(&mut self, reason: &str);
}

impl Default for ViewOptions {
    /// A free port of the loopback interface, and the current folder.
    fn default() -> Self {
        let listen = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0);
        Self { listen, output: PathBuf::from("."), threads: 0, nice: 10, image: ExposeOptions::default() }
    }
}

/// Shows a scene, a job, a saved film or an EXR until `cancel` ends it.
///
/// # Errors
/// An address that cannot be listened on, a film that cannot be read, a file that is no scene, a lens for another file than
/// an EXR. Faults of a scene appear on the page, which shows the scene when they are mended.
pub fn serve(path: &Path, options: &ViewOptions, cancel: &Cancel, events: &mut dyn ViewEvents) -> Result<(), Error> {
    let stored = open_stored(path)?;
    if options.image != ExposeOptions::default() && !matches!(stored, Stored::Exr(_)) {
        let problem = "f-number, transmission and magnification are for an EXR";
        return Err(Error::setting("the lens", problem, "write them in `[lens]` of the job"));
    }
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
            "choose another port, or leave it out for a free one",
        )
    };
    let listener = std::net::TcpListener::bind(options.listen).map_err(fault)?;
    listener.set_nonblocking(true).map_err(fault)?;
    let address = listener.local_addr().map_err(fault)?;
    let token = if address.ip().is_loopback() { None } else { Some(random_token()?) };
    let page = PageAddress::new(address, token.as_deref());
    let subject = Subject { path: path.to_owned(), kind, output: options.output.clone(), nice: options.nice };
    let (session, background) =
        (Session::new(options.threads)?, Session::in_background(options.threads, options.nice)?);
    let shared = Arc::new(Shared::new(subject, session, background));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .max_blocking_threads(8)
        .build()
        .map_err(|e| Error::Threads(e.to_string()))?;
    std::thread::scope(|scope| {
        match stored {
            Stored::Film(saved) => engine::show_film(&shared, *saved),
            Stored::Exr(image) => engine::show_exr(&shared, *image, &options.image)?,
            Stored::Scene => {
                scope.spawn(|| engine::run(&shared));
                scope.spawn(|| engine::watch_files(&shared));
            }
        }
        scope.spawn(|| analysis::run(&shared));
        let served = runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(listener)?;
            let app = router(shared.clone(), Guard::new(address, token));
            events.ready(&page);
            tokio::select! {
                () = server::serve(listener, app) => Ok(()),
                () = watch(&shared, cancel, events) => Ok(()),
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
    Exr(Box<ExrImage>),
}

/// Passes the errors of the scene on, until the view is cancelled.
async fn watch(shared: &Shared, cancel: &Cancel, events: &mut dyn ViewEvents) {
    let mut known = None;
    while !cancel.is_cancelled() {
        let error = lock(&shared.live).error.clone();
        if error != known {
            if let Some(fault) = &error {
                events.failed(&fault.to_string());
            }
            known = error;
        }
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

/// Reads a film or an EXR, and checks that another file can be opened as a scene.
fn open_stored(path: &Path) -> Result<Stored, Error> {
    let ends_in = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    Ok(if ends_in("film") {
        Stored::Film(Box::new(SavedFilm::read(path)?))
    } else if ends_in("exr") {
        Stored::Exr(Box::new(engine::open_exr(path)?))
    } else {
        // A file that does not exist or is no scene is a fault of the command, and no page could mend it.
        let refused = |problem: String| {
            let help = "name a scene, a job, a film or an EXR";
            Error::setting("the scene", format!("{} {problem}", path.display()), help)
        };
        let metadata = std::fs::metadata(path).map_err(|e| refused(format!("cannot be read: {e}")))?;
        if metadata.is_dir() {
            return Err(refused("is a folder".to_owned()));
        }
        if !SCENES.into_iter().any(ends_in) {
            // The error names the format, and a program that converts it.
            Project::open(path)?;
        }
        Stored::Scene
    })
}
