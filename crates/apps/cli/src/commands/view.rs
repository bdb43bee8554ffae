//! `dunkelfeld view`: a render in the browser.

use crate::args::ViewArgs;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say};
use dunkelfeld::Error;
use dunkelfeld::io::PrivateFile;
use dunkelfeld_view::{PageAddress, ViewEvents, ViewOptions, serve};
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
    options.nice = args.nice.unwrap_or(options.nice);
    options.image.keys = args.lens.keys();
    options.image.settings()?;
    let cancel = cancel_on_interrupt();
    // The page that leads to the address stays until the end: a browser may be slow.
    let mut terminal = Terminal { opens: !args.no_open, redirect: None };
    serve(&args.input, &options, &cancel, &mut terminal)?;
    // Only an interrupt ends a view.
    Ok(Outcome::Interrupted)
}

/// Writes the events of the view to the terminal.
struct Terminal {
    opens: bool,
    redirect: Option<PrivateFile>,
}

impl ViewEvents for Terminal {
    fn ready(&mut self, address: &PageAddress) {
        print(&format!("{}\n", address.local));
        if let Some(network) = &address.network {
            say(&format!("for other computers: {network}"));
        }
        say("Ctrl-C ends the view");
        if self.opens {
            self.redirect = open(address);
        }
    }

    fn failed(&mut self, reason: &str) {
        say(&format!("error: {reason}"));
    }
}

/// Opens the page in the browser of the desktop, if there is one. A token does not stand in the list of processes: the browser
/// opens a file that leads to it.
fn open(address: &PageAddress) -> Option<PrivateFile> {
    let programs: &[&str] = match std::env::consts::OS {
        "macos" => &["open"],
        "windows" => &["explorer"],
        // Without a display, a browser would open in the terminal.
        _ if std::env::var_os("DISPLAY").or(std::env::var_os("WAYLAND_DISPLAY")).is_none() => &[],
        _ => &["xdg-open"],
    };
    let redirect = if address.has_token { Some(address.redirect().ok()?) } else { None };
    let target = redirect.as_ref().map_or(address.local.as_ref(), |file| file.path().as_os_str());
    for program in programs {
        let mut command = Command::new(program);
        command.arg(target).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        // Ctrl-C in the terminal ends the view, and not a browser that it has started.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        if command.spawn().is_ok() {
            return redirect;
        }
    }
    None
}
