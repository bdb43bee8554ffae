//! Statuses, the error of a thread, and the border that no panic passes.

use crate::pointers::c_text;
use dunkelfeld::Error;
use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The result of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Success.
    Ok = 0,
    /// A file or a text that cannot be used.
    Input = 1,
    /// A setting outside its range, or that fits no other one.
    Setting = 2,
    /// A scene or a camera that cannot be rendered.
    Scene = 3,
    /// A sensor that cannot be exposed like this.
    Sensor = 4,
    /// A file that cannot be written.
    Output = 5,
    /// More memory than the limit or the machine has.
    OutOfMemory = 6,
    /// A render that was cancelled. Its film has the samples until then.
    Interrupted = 7,
    /// A pointer, a handle, a count or a text that cannot be used.
    Argument = 8,
    /// The scene serves another call.
    Busy = 9,
    /// Header and library do not fit.
    Abi = 10,
    /// A fault of the library. The message has the place.
    Internal = 11,
}

/// A part of the error of the last call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorPart {
    /// The whole message, of one or more lines.
    Message = 0,
    /// The file.
    File = 1,
    /// The place: a key, a line, an argument.
    Place = 2,
    /// The problem.
    Problem = 3,
    /// Words that help.
    Help = 4,
}

/// An error of a call: its status, and its texts by [`ErrorPart`].
#[derive(Debug)]
pub(crate) struct Failure(Box<(Status, [Option<String>; 5])>);

thread_local! {
    static LAST: RefCell<[Option<CString>; 5]> = const { RefCell::new([const { None }; 5]) };
}

impl Failure {
    pub(crate) fn new(status: Status, place: &str, problem: impl Into<String>, help: &str) -> Self {
        let problem = problem.into();
        let message = format!("{place}: {problem}\n  help: {help}");
        Self(Box::new((status, [Some(message), None, Some(place.into()), Some(problem), Some(help.into())])))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Input(_) => Status::Input,
            Error::Build(_) | Error::Camera(_) => Status::Scene,
            Error::Sensor(_) => Status::Sensor,
            Error::Output { .. } => Status::Output,
            Error::Memory { .. } | Error::MemoryNeeded { .. } => Status::OutOfMemory,
            _ => Status::Setting,
        };
        let caret = error.caret();
        let message = if caret.is_empty() { error.to_string() } else { format!("{error}\n{caret}") };
        let parts = error.parts();
        let file = parts.file.map(|file| file.display().to_string());
        let [place, problem, help] = [parts.place, parts.problem, parts.help].map(|text| text.map(Cow::into_owned));
        Self(Box::new((status, [Some(message), file, place, problem, help])))
    }
}

/// Runs a call: catches its panic, and keeps its error for the thread.
pub(crate) fn call(work: impl FnOnce() -> Result<(), Failure>) -> Status {
    call_for(|| work().map(|()| Status::Ok))
}

/// [`call`] of a function that has several statuses without an error.
pub(crate) fn call_for(work: impl FnOnce() -> Result<Status, Failure>) -> Status {
    let result = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        let problem = text.unwrap_or("a panic without a text");
        Err(Failure::new(Status::Internal, "the library", problem, "report it with the scene"))
    });
    let (status, texts) = match result {
        Ok(Status::Interrupted) => {
            let problem = "the render was cancelled";
            let help = "use its film, which has the samples until then";
            *Failure::new(Status::Interrupted, "render", problem, help).0
        }
        Ok(status) => (status, [const { None }; 5]),
        Err(Failure(error)) => *error,
    };
    // A thread that ends has no errors any more.
    let _ = LAST.try_with(|last| *last.borrow_mut() = texts.map(|text| text.map(|t| c_text(&t))));
    status
}

/// A part (a DunkelfeldErrorPart) of the error of the last call of this thread; NULL if there was no error, or if it does not have this part. The text is
/// valid until the next call of this thread.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_last_error(part: i32) -> *const c_char {
    let text = LAST.try_with(|last| {
        let last = last.borrow();
        usize::try_from(part)
            .ok()
            .and_then(|part| last.get(part))
            .and_then(Option::as_ref)
            .map_or(std::ptr::null(), |text| text.as_ptr())
    });
    text.unwrap_or(std::ptr::null())
}
