//! Faults of the program in a thread become faults that the page shows. The program stays usable.

use crate::protocol::Fault;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs work of a thread. A panic becomes a fault: `what` has ended unexpectedly. The state that the work shares is plain data
/// behind locks, which stay usable ([`lock`](crate::shared::lock)).
pub(crate) fn caught<T>(what: &str, help: &str, work: impl FnOnce() -> T) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|cause| {
        let text = cause.downcast_ref::<String>().map(String::as_str);
        let reason = text.or(cause.downcast_ref::<&str>().copied()).unwrap_or("no reason is known");
        Fault::new(format!("{what} ended unexpectedly, by a fault of the program: {reason}"), help)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_fault_with_its_reason() {
        assert_eq!(caught("the render", "restart it", || 7), Ok(7));
        let index = 3;
        let fault = caught("the render", "restart it", || [1, 2][std::hint::black_box(index)]).expect_err("a panic");
        assert!(fault.problem.starts_with("the render ended unexpectedly") && fault.problem.contains("index"));
        assert_eq!(fault.help.as_deref(), Some("restart it"));
        let fault = caught("the analysis", "", || -> () { panic!("no such plane") }).expect_err("a panic");
        assert!(fault.problem.ends_with("no such plane"), "{}", fault.problem);
    }
}
