//! `dunkelfeld view`: a render in the browser.

use crate::args::ViewArgs;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say};
use dunkelfeld::Error;
use dunkelfeld_view::{ViewOptions, serve};
use std::process::{Command, Stdio};

pub(crate) fn run(args: &ViewArgs) -> Result<Outcome, Error> {
    let mut options = ViewOptions::default();
    if let Some(listen) = args.listen {
        options.listen = listen;
    } else if let Some(port) = args.port {
        options.listen.set_port(port);
    }
    if let Some(output) = &args.output {
        options.output.clone_from(output);
    }
    options.threads = args.threads.map_or(0, usize::from);
    let cancel = cancel_on_interrupt();
    serve(&args.input, &options, &cancel, |address| {
        print(&format!("{address}\n"));
        say("Ctrl-C ends the view");
        if !args.no_open {
            open(address);
        }
    })?;
    // Only an interrupt ends a view.
    Ok(Outcome::Interrupted)
}

/// Opens the page in the browser of the desktop, if there is one.
fn open(address: &str) {
    let programs: &[&str] = match std::env::consts::OS {
        "macos" => &["open"],
        "windows" => &["explorer"],
        // Without a display, a browser would open in the terminal.
        _ if std::env::var_os("DISPLAY").or(std::env::var_os("WAYLAND_DISPLAY")).is_none() => &[],
        _ => &["xdg-open"],
    };
    for program in programs {
        let mut command = Command::new(program);
        command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        if command.spawn().is_ok() {
            return;
        }
    }
}
