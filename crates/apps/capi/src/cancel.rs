//! Switches that cancel a render from another thread.

use crate::handles::Handles;
use crate::pointers::Out;
use crate::status::{Status, call};

/// A switch that cancels renders.
#[derive(Debug)]
pub struct Cancel {
    _opaque: (),
}

pub(crate) static CANCELS: Handles<dunkelfeld::Cancel> = Handles::new("cancel");

/// Makes a switch, for the field `cancel` of the options of a render.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_cancel_new(cancel: *mut *mut Cancel) -> Status {
    // SAFETY: what the header says of pointers.
    let cancel = unsafe { Out::of(cancel) };
    call(|| {
        cancel.check("cancel")?;
        cancel.set("cancel", CANCELS.open(dunkelfeld::Cancel::new()))
    })
}

/// Cancels the renders with this switch: they end soon with DUNKELFELD_STATUS_INTERRUPTED and a film. The switch stays cancelled. It
/// takes a lock, so a signal handler must not call it.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_cancel(cancel: *mut Cancel) -> Status {
    call(|| {
        CANCELS.get(cancel)?.cancel();
        Ok(())
    })
}

/// Closes a switch. Renders that use it go on. NULL is allowed.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_cancel_close(cancel: *mut Cancel) -> Status {
    call(|| CANCELS.close(cancel))
}
