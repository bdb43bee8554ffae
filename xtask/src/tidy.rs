//! Placeholder for `cargo xtask tidy`.

/// Checks nothing yet.
pub(crate) fn run() -> Result<(), String> {
    Ok(())
}
