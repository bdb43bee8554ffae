//! The files that the images of a set are made from, with hashes of their contents. They are the same on every machine.

use crate::study::Study;
use dunkelfeld_io::input::{InputFiles, MAX_STREAMED, ReadFault, Role};
use dunkelfeld_io::job::Job;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Component, Path};
use twox_hash::XxHash3_128;

/// Images whose jobs are read for the names of their files.
const JOBS: u64 = 64;

/// An input file of a set.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct InputRecord {
    /// The path relative to the folder that paths of the study refer to, with slashes. The name alone for the study itself
    /// and for a file that the study or a job names by an absolute path.
    pub(crate) path: String,
    /// XXH3 of the content, 128 bits as hexadecimal digits; `None` for a file that cannot be read.
    pub(crate) hash: Option<String>,
    /// Is it the study itself?
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) is_study: bool,
}

/// The input files of a study, each once, by path: `read`, which the first image reads, and those that the jobs of the
/// first 64 images name. Libraries belong to the machine and are left out.
pub(crate) fn input_records(study: &Study, read: &InputFiles) -> Vec<InputRecord> {
    let mut inputs = study.inputs().clone();
    inputs.extend(read);
    // The number of images of the set has no effect, so that a set that grows keeps its list. An image with an error is
    // named when it is made, if the set has it.
    for index in 0..JOBS {
        let Ok(job) = study.job(index) else { continue };
        let Ok(job) = Job::from_text(study.job_path(), job.text) else { continue };
        inputs.extend(job.inputs());
    }
    let mut paths = BTreeSet::new();
    let files = inputs.iter().filter(|input| !matches!(input.role, Role::Library | Role::Report));
    let records: BTreeSet<InputRecord> = files
        // The text of a job is not that of a file.
        .filter(|input| input.role != Role::Job || study.inputs().iter().any(|own| own == *input))
        .map(|input| input.identity.path())
        .filter(|path| paths.insert(path.to_path_buf()))
        .map(|path| InputRecord { path: name_of(path, study), hash: hash_of(path), is_study: path == study.path() })
        .collect();
    records.into_iter().collect()
}

/// The first file that only one of two lists of the same study has, or that has another content. The study itself may have
/// another name and other comments: its keys are compared by the hash of the study.
pub(crate) fn changed_input<'a>(before: &'a [InputRecord], now: &'a [InputRecord]) -> Option<&'a str> {
    let only = |list: &'a [InputRecord], other: &'a [InputRecord]| {
        list.iter().find(|file| !file.is_study && !other.contains(file)).map(|file| file.path.as_str())
    };
    only(now, before).or_else(|| only(before, now))
}

/// The name of an input in a set.
fn name_of(path: &Path, study: &Study) -> String {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    match path.strip_prefix(study.folder()) {
        Ok(relative) if !relative.has_root() && path != study.path() => {
            let mut parts: Vec<String> = Vec::new();
            for part in relative.components() {
                match part {
                    Component::ParentDir if parts.last().is_some_and(|last| last != "..") => drop(parts.pop()),
                    Component::ParentDir => parts.push("..".into()),
                    Component::Normal(part) => parts.push(part.to_string_lossy().into_owned()),
                    _ => {}
                }
            }
            parts.join("/")
        }
        _ => name,
    }
}

/// The hash of the content of a file; `None` if it cannot be read.
pub(crate) fn hash_of(path: &Path) -> Option<String> {
    let hash = || -> Result<u128, ReadFault> {
        let mut file = InputFiles::new().open(path, Role::Result, MAX_STREAMED)?;
        let (mut hash, mut buffer) = (XxHash3_128::new(), vec![0; 1 << 16]);
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(hash.finish_128()),
                count => hash.write(buffer.get(..count).unwrap_or_default()),
            }
        }
    };
    hash().ok().map(|hash| format!("{hash:032x}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const STUDY: &str = "scene = \"part.obj\"\n[study]\njob = \"../jobs/job.toml\"\nname = \"s\"\n[camera]\n\
        position = [0, 1, 0]\nlook_at = [0, 0, 0]\n[sensor]\nmodel = { sequence = [\"imx250\", \"own.toml\"] }\n";

    /// A study with a job, and a sensor that image 1 has.
    fn files(folder: &Path) -> Study {
        for name in ["studies", "jobs"] {
            fs::create_dir_all(folder.join(name)).expect("a folder");
        }
        fs::write(folder.join("studies/study.toml"), STUDY).expect("written");
        fs::write(folder.join("jobs/job.toml"), "[film]\nwidth = 8\nheight = 8\n").expect("written");
        fs::write(folder.join("jobs/part.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("written");
        fs::write(folder.join("jobs/own.toml"), "a sensor").expect("written");
        Study::open(folder.join("studies/study.toml")).expect("a study")
    }

    #[test]
    fn inputs_are_the_same_in_any_folder() {
        let [a, b] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
        let list = input_records(&files(a.path()), &InputFiles::new());
        assert_eq!(list, input_records(&files(b.path()), &InputFiles::new()));
        let paths: Vec<&str> = list.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(paths, ["../jobs/job.toml", "../jobs/own.toml", "../jobs/part.obj", "study.toml"]);
        // The value of the reference implementation is that of one call for the whole content.
        let expected = format!("{:032x}", XxHash3_128::oneshot(b"a sensor"));
        assert_eq!(list[1].hash.as_deref(), Some(expected.as_str()));
    }

    #[test]
    fn changes_are_named_and_another_name_of_the_study_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let study = files(folder.path());
        let list = |study: &Study| input_records(study, &InputFiles::new());
        let before = list(&study);
        assert_eq!(changed_input(&before, &before), None);
        let other = folder.path().join("studies/renamed.toml");
        fs::copy(study.path(), &other).expect("copied");
        let renamed = Study::open(&other).expect("a study");
        assert_eq!(changed_input(&before, &list(&renamed)), None);
        let obj = folder.path().join("jobs/part.obj");
        fs::write(&obj, "v 0 0 0\n").expect("written");
        assert_eq!(changed_input(&before, &list(&study)), Some("../jobs/part.obj"));
        fs::remove_file(&obj).expect("removed");
        assert_eq!(changed_input(&before, &list(&study)), Some("../jobs/part.obj"));
        let less: Vec<InputRecord> = before.iter().filter(|file| !file.path.ends_with("obj")).cloned().collect();
        assert_eq!(changed_input(&before, &less), Some("../jobs/part.obj"));
        assert_eq!(changed_input(&less, &before), Some("../jobs/part.obj"));
    }
}
