//! Separates the folder of a study from the files that it reads, and from reports of other programs.

use crate::series::UNITS;
use dunkelfeld::Error;
use dunkelfeld_io::input::{FileIdentity, InputFile, InputFiles, ReadFault, Role};
use dunkelfeld_report::page::is_page;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Name of the page of a report, in a folder of results.
const REPORT: &str = "report.html";
/// Checks whether an input is in a folder of results, or has another name in it, and whether the page of a report would
/// replace a file of another program.
///
/// # Errors
/// An input is in the folder, or the page would replace such a file.
pub(crate) fn check_folder(folder: &Path, inputs: &InputFiles) -> Result<(), Error> {
    let report = folder.join(REPORT);
    match found_in(folder, inputs) {
        None if folder.is_dir() && is_foreign(&report) => Err(Error::Output {
            file: report,
            problem: "is there already, and is no report of this program".into(),
            help: "name another folder with -o".into(),
        }),
        None => Ok(()),
        Some(input) if !folder.is_dir() => Err(Error::Output {
            file: folder.into(),
            problem: format!("is {} that this run reads, not a folder", input.role.name()),
            help: "name another folder with -o".into(),
        }),
        Some(input) => Err(Error::Output {
            file: folder.into(),
            problem: format!("holds {}, {} that this run reads", input.identity.path().display(), input.role.name()),
            help: "name another folder with -o".into(),
        }),
    }
}

/// Is there a file that is no report of this program?
fn is_foreign(report: &Path) -> bool {
    /// The head of a page is shorter than this limit.
    const HEAD: u64 = 1024;
    match InputFiles::new().open(report, Role::Result, u64::MAX) {
        Err(ReadFault::Missing) => false,
        Err(_) => true,
        Ok(file) => {
            let mut head = Vec::new();
            file.take(HEAD).read_to_end(&mut head).is_err() || !is_page(&String::from_utf8_lossy(&head))
        }
    }
}

/// The folder of the renders of a campaign may be a link.
fn found_in<'a>(folder: &Path, inputs: &'a InputFiles) -> Option<&'a InputFile> {
    let named = inputs.find(&FileIdentity::from_path(folder));
    named.or_else(|| inputs.find_within(folder)).or_else(|| inputs.find_within(&folder.join(UNITS)))
}

/// The default folder of a study of an input: `a-bench` or `a-ptc` in the current folder.
pub fn default_folder(input: &Path, study: &str) -> PathBuf {
    let mut name = input.file_stem().unwrap_or_else(|| "scene".as_ref()).to_os_string();
    name.push(format!("-{study}"));
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_results_holds_no_input() {
        let home = std::env::current_dir().expect("a folder");
        let mut inputs = InputFiles::new();
        inputs.add(&home.join("scene.gltf"), Role::Scene);
        assert!(check_folder(&home, &inputs).is_err());
        assert!(check_folder(&home.join("no-such-folder"), &inputs).is_ok());
        let results = tempfile::tempdir().expect("a temporary folder");
        let page = results.path().join(REPORT);
        let check = |text: &str| {
            std::fs::write(&page, text).expect("writable");
            check_folder(results.path(), &inputs)
        };
        check(&crate::report::page::page("photon transfer", &[])).expect("a report of ours");
        for foreign in ["", "<html><head></head></html>"] {
            let message = check(foreign).expect_err("a page of somebody else").to_string();
            assert!(message.contains(REPORT) && message.contains("help:"), "{message}");
        }
        assert_eq!(default_folder(&home.join("no-such-scene.gltf"), "ptc"), Path::new("no-such-scene-ptc"));
    }
}
