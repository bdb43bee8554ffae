//! Errors of a drawn job, which is in no file, at the keys of the study and of the job that it comes from.

use crate::study::Study;
use dunkelfeld_io::InputError;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::toml_file::TomlFile;
use toml::Value;

impl Study {
    /// An error of the drawn job of an image, at the line of the study or of its job that has the key. Without such a line
    /// the error has the name of the key alone.
    pub(crate) fn in_study(&self, error: InputError, index: u64) -> InputError {
        if error.file != self.job_path() {
            return error;
        }
        let InputError { place, problem, help, source_span, read, .. } = error;
        let drawn = source_span.map(|span| (TomlFile::from_text(self.job_path(), span.text), span.range));
        let path = drawn.and_then(|(text, range)| text.path_at(&range)).unwrap_or_default();
        let at = |file: &TomlFile, path: &[String]| {
            let keys: Vec<&str> = path.iter().map(String::as_str).collect();
            let is_there = !keys.is_empty() && file.has_key(&keys);
            is_there.then(|| file.error_at_key(&keys, problem.clone(), help.clone()))
        };
        let of_study = || at(self.source(), &self.own_path(&path)?);
        let of_job = || at(&TomlFile::read(self.job_path(), Role::Job, &mut InputFiles::new()).ok()?, &path);
        let found = match of_study() {
            None if !self.base().is_empty() => of_job(),
            found => found,
        };
        match found {
            Some(found) => InputError { place: format!("image {index}, {}", found.place), read, ..found },
            None => {
                let place = format!("image {index}, job: {place}");
                InputError { read, ..InputError::new(self.path(), place, problem, help) }
            }
        }
    }

    /// The path in the study of a key of the drawn job. Lists of tables of the study come behind those of its job. `None` for an
    /// entry of the job, and for cameras, which a study changes by their names.
    fn own_path(&self, path: &[String]) -> Option<Vec<String>> {
        let mut own = path.to_vec();
        let of_job = match path.first().and_then(|key| self.base().get(key)) {
            Some(Value::Array(list)) if list.iter().all(Value::is_table) => list.len(),
            _ => return Some(own),
        };
        if path.first().is_some_and(|key| key == "camera") {
            return None;
        }
        if let Some(number) = own.get_mut(1) {
            *number = number.parse::<usize>().ok()?.checked_sub(of_job)?.to_string();
        }
        Some(own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOB: &str = r#"# a job
scene = "none"
[film]
width = 8
height = 8
[[light]]
name = "a"
kind = "panel"
power = "1W"
"#;
    const STUDY: &str = r#"# a study
[study]
job = "job.toml"

[budget]
spp = { choice = [4] } # own

[[light]]
name = "a"
power = { uniform = ["1W", "2W"] }
"#;

    #[test]
    fn errors_of_drawn_keys_have_the_line_of_their_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        for (from, to, file, line, place) in [
            ("[4] }", "[-4] }", "study.toml", "spp = { choice = [-4] } # own", "[budget] spp"),
            ("# own", "\nsamples = 3", "study.toml", "samples = 3", "[budget] samples"),
            (
                "[\"1W\", \"2W\"]",
                "[\"1ms\", \"2ms\"]",
                "study.toml",
                "power = { uniform = [\"1ms\"",
                "[[light]] 1, power",
            ),
            ("width = 8", "width = -8", "job.toml", "width = -8", "[film] width"),
            ("\"panel\"", "\"pannel\"", "job.toml", "kind = \"pannel\"", "[[light]] 1, kind"),
        ] {
            assert!(JOB.contains(from) != STUDY.contains(from), "{from}");
            std::fs::write(at("job.toml"), JOB.replace(from, to)).expect("written");
            std::fs::write(at("study.toml"), STUDY.replace(from, to)).expect("written");
            let study = Study::open(at("study.toml")).expect("a study");
            let error = match study.check_jobs(1) {
                Err(dunkelfeld::Error::Input(error)) => error,
                other => panic!("{to}: {other:?}"),
            };
            let text = std::fs::read_to_string(at(file)).expect("a file");
            let number = 1 + text.lines().position(|l| l.contains(line)).expect("a line");
            assert_eq!(error.file, at(file));
            assert_eq!(error.place, format!("image 0, {place}"));
            let caret = error.caret();
            assert!(caret.contains(line) && caret.contains(&format!("{number} |")), "{number}: {caret}");
        }
    }
}
