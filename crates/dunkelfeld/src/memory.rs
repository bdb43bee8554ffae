//! The account of a run's memory. It is computed before the run, and compared with a limit and with the available
//! memory.

pub(crate) mod estimate;

pub use estimate::KeptFilms;
pub(crate) use estimate::{RenderNeeds, denoise_account, expose_account, merge_account, render_account};

use dunkelfeld_film::Film;
use dunkelfeld_io::process::{can_reserve, peak_memory};
use dunkelfeld_render::Error;
use serde::Serialize;
use std::fmt::Write;

/// An item of the account.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MemoryItem {
    /// Its name, as in `film`.
    pub name: String,
    /// Bytes in each phase.
    pub bytes: Vec<u64>,
}

/// The memory of a run, by item and phase. For textures and scene the account contains their measured size. All else is
/// computed from the number of pixels and threads (`docs/memory.md`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MemoryAccount {
    /// Names of the phases of the run, in their order.
    pub phases: Vec<String>,
    /// The items, each with one number per phase.
    pub items: Vec<MemoryItem>,
    /// Bytes of all items in the phase with the largest sum.
    pub peak_bytes: u64,
}

/// The account of a run, and its measured memory: a field of the statistics.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MemoryStats {
    /// The account.
    #[serde(flatten)]
    pub account: MemoryAccount,
    /// Peak resident set of the process \[bytes\]. `None` where the system does not report it.
    pub measured_bytes: Option<u64>,
    /// Size of the film at the end \[bytes\].
    pub film_bytes: u64,
}

impl MemoryAccount {
    pub(crate) fn new(phases: &[&str]) -> Self {
        Self { phases: phases.iter().map(ToString::to_string).collect(), items: Vec::new(), peak_bytes: 0 }
    }

    /// Adds an item with its bytes in each phase. An item without bytes is left out.
    pub(crate) fn add(&mut self, name: &str, bytes: &[u64]) {
        if bytes.iter().any(|&b| b > 0) {
            self.items.push(MemoryItem { name: name.into(), bytes: bytes.to_vec() });
        }
        self.peak_bytes = self.sums().into_iter().max().unwrap_or(0);
    }

    /// Bytes of all items in each phase.
    pub fn sums(&self) -> Vec<u64> {
        let of = |phase| {
            let bytes = self.items.iter().filter_map(|item| item.bytes.get(phase));
            bytes.fold(0, |sum: u64, &bytes| sum.saturating_add(bytes))
        };
        (0..self.phases.len()).map(of).collect()
    }

    /// As a table, a line for each item: megabytes (10^6 bytes) in each phase, and the sums.
    pub fn table(&self) -> String {
        let width = self.items.iter().map(|item| item.name.len()).max().unwrap_or(0).max(14);
        let mut text = format!("  {:<width$}", "memory [MB]");
        for phase in &self.phases {
            let _ = write!(text, "{phase:>10}");
        }
        let mut line = |name: &str, bytes: &[u64]| {
            let _ = write!(text, "\n  {name:<width$}");
            for &bytes in bytes {
                let _ = write!(text, "{:>10}", megabytes(bytes));
            }
        };
        self.items.iter().for_each(|item| line(&item.name, &item.bytes));
        line("sum", &self.sums());
        text
    }

    /// Checks whether the run may begin: its peak must be within the limit, if there is one, and the system must be
    /// able to allocate the part of it beyond `held`, the bytes that the process already uses. The peak is reserved and
    /// freed immediately.
    ///
    /// # Errors
    /// The peak is above the limit, or above the available memory.
    pub(crate) fn check(&self, limit: Option<u64>, held: u64, help: &str) -> Result<(), Error> {
        let refuse = |problem: String| {
            let more = if limit.is_some() { ", or raise the limit" } else { ", or end other programs" };
            Err(Error::MemoryNeeded { problem, account: self.table(), help: format!("{help}{more}") })
        };
        let peak = self.peak_bytes;
        if let Some(limit) = limit.filter(|&limit| peak > limit) {
            return refuse(format!(
                "the run needs {} MB of memory, more than the limit of {} MB (--memory, or memory in [budget] of the job)",
                megabytes(peak),
                megabytes(limit)
            ));
        }
        if !can_reserve(peak.saturating_sub(held)) {
            return refuse(format!("the run needs {} MB of memory, which this system does not have", megabytes(peak)));
        }
        Ok(())
    }
}

impl MemoryStats {
    /// The memory of the process until now, for a run with this account and film.
    pub(crate) fn new(account: MemoryAccount, film: &Film) -> Self {
        Self { account, measured_bytes: peak_memory(), film_bytes: film.bytes() }
    }

    /// Measures anew.
    pub(crate) fn measure(&mut self) {
        self.measured_bytes = peak_memory();
    }
}

/// Checks before the copy of an image whether its bytes are within a limit, and whether this system has them.
///
/// # Errors
/// More bytes than `limit`, or than the available memory.
pub fn check_image_memory(bytes: u64, limit: Option<u64>) -> Result<(), Error> {
    let mut account = MemoryAccount::new(&["read"]);
    account.add("image", &[bytes]);
    account.check(limit, 0, "use fewer pixels")
}

fn megabytes(bytes: u64) -> String {
    let megabytes = bytes as f64 * 1e-6;
    if megabytes < 100.0 { format!("{megabytes:.1}") } else { format!("{megabytes:.0}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn account() -> MemoryAccount {
        let mut account = MemoryAccount::new(&["render", "write"]);
        account.add("film", &[100_000_000, 100_000_000]);
        account.add("plan", &[7_000_000, 0]);
        account.add("nothing", &[0, 0]);
        account.add("files", &[0, 5_500_000]);
        account
    }

    #[test]
    fn a_run_above_its_limit_or_beyond_all_memory_is_refused_with_its_account() {
        let account = account();
        account.check(None, 0, "-").expect("every machine has that");
        account.check(Some(107_000_000), 0, "-").expect("as much as it needs");
        let error = account.check(Some(106_999_999), 0, "use fewer pixels").expect_err("a byte too much").to_string();
        for part in ["107 MB", "--memory", "[budget]", "film", "sum", "help: use fewer pixels"] {
            assert!(error.contains(part), "{part}: {error}");
        }
        let mut vast = MemoryAccount::new(&["render"]);
        vast.add("film", &[u64::MAX]);
        vast.add("more", &[u64::MAX]);
        let error = vast.check(None, 0, "use fewer pixels").expect_err("no machine has that").to_string();
        assert!(error.contains("does not have") && error.contains("film"), "{error}");
        // Memory that the process already uses is not allocated again.
        vast.check(None, u64::MAX, "-").expect("nothing is left to ask for");
    }
}
