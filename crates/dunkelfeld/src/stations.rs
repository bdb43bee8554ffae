//! Preset stations: camera, lens, film and lights of inspection cells, with a stand-in part.

use dunkelfeld_render::Error;

/// A station: camera, lens, film and lights of an inspection cell, as keys of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Station {
    /// Its name, as in `dark-field-ring`.
    pub name: &'static str,
    keys: &'static str,
    /// Changes of the part that the station needs.
    changes: &'static str,
    /// Its stand-in part.
    part: &'static str,
}

/// The preset stations.
pub const STATIONS: [Station; 7] = [
    Station {
        part: include_str!("../stations/polished-part.toml"),
        ..station("dark-field-ring", include_str!("../stations/dark-field-ring.toml"))
    },
    station("bright-field-ring", include_str!("../stations/bright-field-ring.toml")),
    station("dome", include_str!("../stations/dome.toml")),
    station("bars", include_str!("../stations/bars.toml")),
    station("coaxial", include_str!("../stations/coaxial.toml")),
    station("backlight", include_str!("../stations/backlight.toml")),
    Station {
        changes: include_str!("../stations/line-scan-motion.toml"),
        ..station("line-scan", include_str!("../stations/line-scan.toml"))
    },
];

/// Places in the world of the line scan, above the stand-in part, and the same places for the centre of all objects.
const IN_WORLD: [(&str, &str); 2] = [
    ("look_at = [0, \"4mm\", 0]", "look_at = \"*\""),
    ("position = [0, \"90mm\", \"-60mm\"]", "distance = \"105mm\"\nelevation = \"55deg\"\nazimuth = \"90deg\""),
];

/// The stand-in part of most stations without a scene.
const PART: &str = include_str!("../stations/part.toml");

const fn station(name: &'static str, keys: &'static str) -> Station {
    Station { name, keys, changes: "", part: PART }
}

impl Station {
    /// The station of a name.
    pub fn find(name: &str) -> Option<Self> {
        STATIONS.into_iter().find(|s| s.name == name)
    }

    /// The station of a name.
    ///
    /// # Errors
    /// There is none; the help lists all names.
    pub fn named(name: &str) -> Result<Self, Error> {
        Self::find(name).ok_or_else(|| {
            let names: Vec<&str> = STATIONS.iter().map(|s| s.name).collect();
            let problem = format!("there is no station \"{name}\"");
            Error::setting("station", problem, format!("write one of {}", names.join(", ")))
        })
    }

    /// One sentence about it.
    pub fn summary(&self) -> &'static str {
        self.keys.lines().next().unwrap_or_default().trim_start_matches("# ")
    }

    /// A job of the station with the stand-in part.
    pub fn job(&self) -> String {
        let Self { name, keys, changes, part } = self;
        format!(
            "# Station \"{name}\" with a stand-in part. Render it with `dunkelfeld render` and this file.\n\
             scene = \"none\"\nbudget = {{ time = \"20s\" }}\n\n{keys}{part}{changes}"
        )
    }

    /// Its keys, and its changes of the part, for a scene: names of the stand-in are those of all objects, and places in the
    /// world are those beside them.
    pub(crate) fn keys_for_scene(&self) -> (String, String) {
        let renamed = |text: &str| {
            let places = IN_WORLD.iter().fold(text.to_string(), |text, (world, beside)| text.replace(world, beside));
            places.replace("\"part*\"", "\"*\"")
        };
        (renamed(self.keys), renamed(self.changes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::job::Job;

    /// The camera of each station looks at the objects of a scene, wherever they are.
    #[test]
    fn stations_of_a_scene_have_no_place_in_the_world() {
        for station in STATIONS {
            let (keys, _) = station.keys_for_scene();
            assert!(keys.contains("look_at = \"*\"") && !keys.contains("position"), "{}: {keys}", station.name);
        }
        for (world, _) in IN_WORLD {
            assert!(STATIONS.iter().any(|station| station.keys.contains(world)), "{world}");
        }
    }

    #[test]
    fn stations_are_short_jobs_that_parse() {
        for station in STATIONS {
            let job = Job::from_text("station.toml", station.job());
            job.unwrap_or_else(|e| panic!("{}: {e}", station.name));
            assert!(station.summary().ends_with('.') && station.summary().len() > 20, "{}", station.name);
            let lines = station.keys.lines().chain(station.changes.lines());
            let lines = lines.filter(|line| !line.trim().is_empty() && !line.starts_with('#')).count();
            assert!(lines <= 12, "{} has {lines} lines", station.name);
            assert_eq!(Station::find(station.name), Some(station));
        }
        assert_eq!(Station::find("ring"), None);
    }
}
