//! Errors of a drawn job, which is in no file, at the keys of the study and of the job that it comes from.

use crate::study::Study;
use dunkelfeld_io::InputError;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::toml_file::TomlFile;
use toml::{Table, Value};

impl Study {
    /// An error of the drawn job of an image, at the line of the study or of its job that has the key. Without such a line
    /// the error has the name of the key alone.
    pub(crate) fn in_study(&self, error: InputError, index: u64) -> InputError {
        if error.file != self.job_path() {
            return error;
        }
        let InputError { place, problem, help, source_span, read, .. } = error;
        let drawn = source_span.map(|span| (TomlFile::from_text(self.job_path(), span.text), span.range));
        let drawn = drawn.and_then(|(file, range)| Some((file.path_at(&range)?, file.parse().ok()?)));
        let (path, job): (Vec<String>, Table) = drawn.unwrap_or_default();
        let at = |file: &TomlFile, path: &[String]| {
            let keys: Vec<&str> = path.iter().map(String::as_str).collect();
            let is_there = !keys.is_empty() && file.has_key(&keys);
            is_there.then(|| file.error_at_key(&keys, problem.clone(), help.clone()))
        };
        // A value inside of a distribution has no line of its own: that of the distribution counts.
        let of_study = |own: &[String]| (1..=own.len()).rev().find_map(|end| at(self.source(), &own[..end]));
        let of_job = || at(&TomlFile::read(self.job_path(), Role::Job, &mut InputFiles::new()).ok()?, &path);
        let found = match self.own_path(&path, &job, index) {
            Some(own) => of_study(&own),
            None if !self.base().is_empty() => of_job(),
            None => None,
        };
        match found {
            Some(found) => InputError { place: format!("image {index}, {}", found.place), read, ..found },
            None => {
                let place = format!("image {index}, job: {place}");
                InputError { read, ..InputError::new(self.path(), place, problem, help) }
            }
        }
    }

    /// The path in the study of a key of the drawn job of an image. Lists of tables of the study come behind those of its
    /// job; cameras of the study change those of the job by their names, and others come behind. `None` for a value that the
    /// study does not have.
    fn own_path(&self, path: &[String], job: &Table, index: u64) -> Option<Vec<String>> {
        let draws = self.draws(index);
        let value = self.template.draw(draws, "", &mut self.named(draws), &mut |_, _| {}).ok()?;
        let mut own = path.to_vec();
        let first = path.first()?;
        if let Some(Value::Array(list)) = self.base().get(first)
            && list.iter().all(Value::is_table)
        {
            match (value.get(first)?, path.get(1)) {
                (changes, Some(number)) if first == "camera" => {
                    let name = |camera: &Value| camera.get("name").cloned();
                    let changed = name(job.get("camera")?.get(number.parse::<usize>().ok()?)?);
                    match changes {
                        Value::Array(list) => own[1] = list.iter().position(|c| name(c) == changed)?.to_string(),
                        one if name(one).is_none_or(|name| Some(name) == changed) => drop(own.remove(1)),
                        _ => return None,
                    }
                }
                (Value::Array(more), Some(number)) if more.iter().all(Value::is_table) => {
                    own[1] = number.parse::<usize>().ok()?.checked_sub(list.len())?.to_string();
                }
                _ => {}
            }
        }
        let has_value = own.iter().try_fold(&value, |value, step| match value {
            Value::Table(table) => table.get(step),
            Value::Array(items) => items.get(step.parse::<usize>().ok()?),
            _ => None,
        });
        has_value.map(|_| own)
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
diameter = "20mm"
distance = "200mm"
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

    /// The place of the error of image 0, and its line; a job stands beside the study.
    fn error_of(job: &str, study: &str) -> (String, String) {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("job.toml"), job).expect("written");
        std::fs::write(at("study.toml"), study).expect("written");
        match Study::open(at("study.toml")).expect("a study").check_jobs(1) {
            Err(dunkelfeld::Error::Input(error)) => {
                let file = error.file.file_name().expect("a name").to_string_lossy().into_owned();
                (format!("{file}: {}", error.place), error.caret())
            }
            other => panic!("{study}: {other:?}"),
        }
    }

    #[test]
    fn drawn_cameras_and_lists_have_the_line_of_the_study() {
        let camera = "[[camera]]\nname = \"a\"\nposition = [0, 1, 0]\nlook_at = [0, 0, 0]\nvertical_fov = \"25deg\"\n";
        let job =
            format!("scene = \"none\"\n[film]\nwidth = 8\nheight = 8\n[lens]\ndistortion = [0.01, 0, 0, 0]\n{camera}");
        let head = "[study]\njob = \"job.toml\"\n";
        let fov = "vertical_fov = { uniform = [\"-5deg\", \"-4deg\"] }";
        for (text, place, line) in [
            (format!("[[camera]]\nname = \"a\"\n{fov}"), "[[camera]] 1, vertical_fov", fov),
            (format!("[camera]\n{fov}"), "[camera] vertical_fov", fov),
            (
                format!("{camera}\n{}\n{fov}", "[[camera]]\nname = \"b\"\nposition = [0, 1, 0]"),
                "[[camera]] 2, vertical_fov",
                fov,
            ),
            (
                "[[camera]]\nname = \"a\"\nposition = { choice = [[0, \"1m\", \"x\"]] }".into(),
                "[[camera]] 1, position",
                "position = { choice",
            ),
            (
                "[lens]\ndistortion = { choice = [[\"x\", 0, 0, 0]] }".into(),
                "[lens] distortion",
                "distortion = { choice",
            ),
        ] {
            let (found, caret) = error_of(&job, &format!("{head}{text}\n"));
            assert_eq!(found, format!("study.toml: image 0, {place}"), "{text}");
            assert!(caret.contains(line), "{text}: {caret}");
        }
        // A key of the job beside keys of the study.
        let (found, caret) = error_of(
            &job.replace("25deg", "-25deg"),
            &format!("{head}[[camera]]\nname = \"a\"\nposition = {{ choice = [[0, 1, 0]] }}\n"),
        );
        assert_eq!(found, "job.toml: image 0, [[camera]] 1, vertical_fov");
        assert!(caret.contains("vertical_fov = \"-25deg\""), "{caret}");
        // Without a job.
        let study = format!("{}\n[study]\n", job.replace("[0.01, 0, 0, 0]", "{ choice = [[\"x\", 0, 0, 0]] }"));
        let (found, caret) = error_of("", &study);
        assert_eq!(found, "study.toml: image 0, [lens] distortion");
        assert!(caret.contains("distortion = { choice"), "{caret}");
    }

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
