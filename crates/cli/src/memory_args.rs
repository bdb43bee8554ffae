//! The flag `--memory` of every command that accounts for its memory.

use clap::Args;
use dunkelfeld::io::quantity::{Memory, QuantityError};

/// How much memory a command may need.
#[derive(Debug, Args)]
pub(crate) struct MemoryArgs {
    /// The most memory that the command may need, as in 6GB or 512MiB. What it will need is computed before it works; if that is more,
    /// the command ends with the account of it and exit code 2.
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub(crate) memory: Option<u64>,
}

fn memory(text: &str) -> Result<u64, String> {
    let size: Memory = text.parse().map_err(|e: QuantityError| e.to_string())?;
    size.whole().ok_or_else(|| "write a size above zero, such as 6GB".into())
}
