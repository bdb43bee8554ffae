//! Search for the library Intel Open Image Denoise.

use dunkelfeld_denoise::DenoiseError;
use std::path::Path;

#[cfg(feature = "oidn")]
pub(crate) use with_adapter::{load, searched_places};

/// The error of a program without the adapter.
#[cfg(not(feature = "oidn"))]
pub(crate) fn load(_named: Option<&Path>) -> Result<dunkelfeld_denoise::Builtin, DenoiseError> {
    let problem = "Intel Open Image Denoise: this program was built without the feature `oidn`";
    Err(DenoiseError::Unavailable(problem.into()))
}

/// The places that [`load`] searches, as text.
#[cfg(not(feature = "oidn"))]
pub(crate) fn searched_places() -> String {
    "nowhere, as this program was built without the feature `oidn`".into()
}

#[cfg(feature = "oidn")]
mod with_adapter {
    use super::{DenoiseError, Path};
    use dunkelfeld_denoise::Oidn;
    use dunkelfeld_denoise::oidn::{Candidate, standard_names, standard_places};
    use dunkelfeld_io::libraries::{find_libraries, libraries_beside};
    use std::path::PathBuf;

    const OIDN_STEM: &str = "OpenImageDenoise";
    const THREADS_STEM: &str = "tbb";

    /// The places that [`load`] searches, as text.
    pub(crate) fn searched_places() -> String {
        let (names, places) = (standard_names().join(", "), standard_places().join(", "));
        format!("{names} where the loader of the system searches, and the folders {places}")
    }

    /// The named library, or else the first that the system has.
    pub(crate) fn load(named: Option<&Path>) -> Result<Oidn, DenoiseError> {
        let with_threads = |library: PathBuf| {
            // Libraries that it needs may be beside it, under names that the loader does not search.
            let companions = libraries_beside(&library, THREADS_STEM);
            Candidate { library, companions }
        };
        let candidates: Vec<Candidate> = match named {
            Some(path) => match find_libraries(path, OIDN_STEM) {
                none if none.is_empty() => {
                    let problem = format!("there is no {OIDN_STEM} library in {}", path.display());
                    return Err(DenoiseError::Unavailable(problem));
                }
                libraries => libraries.into_iter().map(with_threads).collect(),
            },
            None => {
                let places = standard_places().iter().flat_map(|place| find_libraries(Path::new(place), OIDN_STEM));
                // A place that does not exist is no candidate.
                let places = places.filter(|path| path.is_file()).map(with_threads);
                standard_names().iter().map(Candidate::new).chain(places).collect()
            }
        };
        Oidn::load(&candidates)
    }
}
