//! Scenes of single lights: one film for each light of a scene, from which the image with any factors follows.

use super::open::{Compiled, Setup, compile_and};
use super::{Project, kept_description};
use crate::memory::{LightFilmsNeeds, MemoryAccount, light_films_account};
use dunkelfeld_render::{Error, RenderSettings, thread_count};

impl Project {
    /// The names of the lights, each once, in the order of [`Scene::light_inventory`](dunkelfeld_scene::Scene).
    pub fn light_names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for light in self.scene.light_inventory() {
            if !names.contains(&light.name) {
                names.push(light.name);
            }
        }
        names
    }

    /// The project with a scene in which only one light emits
    /// ([`SceneBuilder::keep_light`](dunkelfeld_scene::SceneBuilder::keep_light)), with the present settings and overrides.
    /// It shares meshes, trees and texels with this project, and cannot be changed itself. For independent films, give
    /// each of these projects its own [`RenderSettings::seed`].
    ///
    /// # Errors
    /// A project that was opened without [`ProjectOptions::can_change`](super::ProjectOptions::can_change).
    pub fn only_light(&mut self, name: &str) -> Result<Self, Error> {
        let description = kept_description(self.description.as_deref_mut())?;
        let keep = |scene: &mut dunkelfeld_scene::SceneBuilder| {
            scene.keep_light(name);
            Ok(())
        };
        let (source, cache) = (description.imported.clone(), &mut description.cache);
        let options = (description.without.as_slice(), self.settings.threads);
        let Compiled { scene, report, setup, .. } = compile_and(&self.job, source, options, Some(cache), keep)?;
        let Setup { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings } =
            Setup { settings: self.settings.clone(), ..setup };
        Ok(Self {
            scene,
            settings,
            outputs,
            warnings,
            report,
            optics,
            lens,
            film,
            inputs,
            job,
            has_job_file: self.has_job_file,
            part,
            own_pitch,
            command: None,
            description: None,
            has_all_findings: false,
        })
    }

    /// The memory of a program that renders a film for each of so many lights at the same time, with the settings, and shows
    /// copies of the films.
    pub fn memory_of_light_films(&self, settings: &RenderSettings, lights: usize) -> LightFilmsMemory {
        let description = self.description.as_ref().map_or(0, |description| description.bytes());
        let threads = thread_count(settings.threads);
        let needs = LightFilmsNeeds { scene: &self.scene.summary(), description, settings, lights, threads };
        let (held, account) = light_films_account(needs);
        LightFilmsMemory { account, held, limit: settings.memory_limit }
    }
}

/// The memory of films for each light.
#[derive(Clone, Debug)]
pub struct LightFilmsMemory {
    account: MemoryAccount,
    /// Bytes that the program already uses.
    held: u64,
    limit: Option<u64>,
}

impl LightFilmsMemory {
    /// Bytes beside the program and its scene.
    pub fn bytes(&self) -> u64 {
        self.account.peak_bytes.saturating_sub(self.held)
    }

    /// Checks the memory against the limit of the settings and against that of the system.
    ///
    /// # Errors
    /// There is less memory.
    pub fn check(&self) -> Result<(), Error> {
        let help = "use one film for all lights, or render fewer pixels";
        self.account.check(self.limit, self.held, help)
    }
}
