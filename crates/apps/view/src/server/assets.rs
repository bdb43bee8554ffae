//! The files of the page, which are part of the program.

/// The page itself.
pub(super) const INDEX: &str = include_str!("../../assets/index.html");

macro_rules! assets {
    ($($name:literal $kind:literal)*) => {
        &[$(($name, $kind, include_str!(concat!("../../assets/", $name)))),*]
    };
}

/// Names, types and contents of its files.
const FILES: &[(&str, &str, &str)] = assets! {
    "accuracy.js" "text/javascript; charset=utf-8"
    "api.js" "text/javascript; charset=utf-8"
    "camera_panel.js" "text/javascript; charset=utf-8"
    "chart.js" "text/javascript; charset=utf-8"
    "colormap.js" "text/javascript; charset=utf-8"
    "dom.js" "text/javascript; charset=utf-8"
    "format.js" "text/javascript; charset=utf-8"
    "header.js" "text/javascript; charset=utf-8"
    "icon.svg" "image/svg+xml"
    "keys.js" "text/javascript; charset=utf-8"
    "legend.js" "text/javascript; charset=utf-8"
    "main.js" "text/javascript; charset=utf-8"
    "measure_panel.js" "text/javascript; charset=utf-8"
    "measurements.js" "text/javascript; charset=utf-8"
    "noise_panel.js" "text/javascript; charset=utf-8"
    "pictures.js" "text/javascript; charset=utf-8"
    "probe_panel.js" "text/javascript; charset=utf-8"
    "problems.js" "text/javascript; charset=utf-8"
    "requests.js" "text/javascript; charset=utf-8"
    "save_panel.js" "text/javascript; charset=utf-8"
    "scene_panel.js" "text/javascript; charset=utf-8"
    "shapes.js" "text/javascript; charset=utf-8"
    "store.js" "text/javascript; charset=utf-8"
    "style.css" "text/css; charset=utf-8"
    "tone.js" "text/javascript; charset=utf-8"
    "toolbar.js" "text/javascript; charset=utf-8"
    "tools.js" "text/javascript; charset=utf-8"
    "viewer.js" "text/javascript; charset=utf-8"
};

/// Type and content of a file.
pub(super) fn file(name: &str) -> Option<(&'static str, &'static str)> {
    FILES.iter().find(|(file, ..)| *file == name).map(|(_, kind, content)| (*kind, *content))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Each file of the folder is served, except the types that only the type checker reads.
    #[test]
    fn all_files_of_the_folder_are_served() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
        let names = std::fs::read_dir(folder).expect("folder").map(|entry| {
            let entry = entry.expect("entry");
            entry.file_name().into_string().expect("UTF-8")
        });
        let is_served = |name: &String| name != "index.html" && !name.ends_with(".d.ts");
        let wanted: BTreeSet<String> = names.filter(is_served).collect();
        let served: BTreeSet<String> = FILES.iter().map(|(name, ..)| (*name).to_owned()).collect();
        assert_eq!(served, wanted);
    }

    /// The page needs no network: no address of another server occurs in it.
    #[test]
    fn no_file_refers_to_another_server() {
        let contents = FILES.iter().map(|(name, _, content)| (*name, *content)).chain([("index.html", INDEX)]);
        for (name, content) in contents {
            for (i, line) in content.lines().enumerate() {
                let line = line.replace("http://www.w3.org/", "");
                let foreign = ["http://", "https://", "src=\"//", "@import"].iter().any(|text| line.contains(text));
                assert!(!foreign, "{name}:{}: {line}", i + 1);
            }
        }
    }
}
