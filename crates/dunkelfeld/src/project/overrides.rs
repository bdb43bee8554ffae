//! Changes of an opened project by keys of a job: only the parts of the scene that change are built again.

use super::Project;
use super::open::{Compiled, compile_and};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::import::Imported;
use dunkelfeld_io::job::Job;
use dunkelfeld_render::Error;
use dunkelfeld_scene::{BuildCache, Effect, Material, SceneBuilder};

/// The description of an opened project.
#[derive(Debug)]
pub(super) struct Description {
    /// The job that was opened, or one that contains the scene file alone.
    pub(super) base: Job,
    /// The scene files before any change.
    pub(super) imported: Imported,
    pub(super) without: Vec<Effect>,
    pub(super) cache: BuildCache,
}

impl Description {
    /// Memory of the meshes \[bytes\]. The texels belong to the compiled scene as well.
    pub(super) fn bytes(&self) -> u64 {
        self.imported.scene.meshes.iter().map(|part| part.mesh.bytes() as u64).sum()
    }
}

impl Project {
    /// Changes scene and settings by keys of a job file (`docs/job-file.md`), which are merged into the job: tables key by
    /// key, lists of tables (`[[object]]`, `[[material]]`, `[[light]]`) are extended, and every other value is replaced. No
    /// key is removed: keys that exclude each other, such as `radiance` and `image` of `[environment]`, are an error
    /// together. The overrides replace those of an earlier call; an empty text is the project as it was opened.
    ///
    /// Meshes and trees of scene files that do not change are used again; objects that the job makes (`kind`) are made
    /// again. Files are read again only if the keys name others. The scene has the bits of a job file with these keys.
    /// The settings are then those of the job with these keys. Lines in errors are those of the merged text.
    ///
    /// ```no_run
    /// let mut project = dunkelfeld::Project::open("station.toml")?;
    /// for degrees in 0..100 {
    ///     project.set_overrides(&format!("[[object]]\nname = \"part\"\nrotate = [0, \"{degrees}deg\", 0]"))?;
    ///     project.render()?.save_image(format!("pose-{degrees}.png"))?;
    /// }
    /// # Ok::<(), dunkelfeld::Error>(())
    /// ```
    ///
    /// # Errors
    /// A text that is not TOML, keys and values that a job may not have, names that match nothing, a scene that cannot be
    /// built, and a project that was opened without [`ProjectOptions::can_change`](super::ProjectOptions::can_change). The
    /// project then stays as it was.
    pub fn set_overrides(&mut self, overrides: &str) -> Result<(), Error> {
        let description = self.description.as_deref().ok_or_else(not_kept)?;
        let changed = description.base.with_overrides(overrides)?;
        self.change_to(changed, |_| Ok(()))
    }

    /// Replaces the job of the project by another one, and then changes the description of its scene by `edit`, for example
    /// by more objects. Paths in the text are relative to the folder of the job that was opened, and errors have its name.
    /// Memory and settings are as for [`Project::set_overrides`].
    ///
    /// # Errors
    /// As [`Project::set_overrides`], and those of `edit`.
    pub fn set_job(
        &mut self,
        text: &str,
        edit: impl FnOnce(&mut SceneBuilder) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let description = self.description.as_deref().ok_or_else(not_kept)?;
        let changed = Job::from_text(description.base.path(), text)?;
        self.change_to(changed, edit)
    }

    /// The names of the objects that the scene has with another job in place of that of the project, without a build.
    /// Objects without meshes are left out. Scene files are read only if the job names others than the project.
    ///
    /// # Errors
    /// Names that match nothing, files that cannot be read, and a project that was opened without
    /// [`ProjectOptions::can_change`](super::ProjectOptions::can_change).
    pub fn object_names_of(&self, job: &Job) -> Result<Vec<String>, Error> {
        let description = self.description.as_deref().ok_or_else(not_kept)?;
        let mut scene =
            if job.has_scene_of(&self.job) { description.imported.clone() } else { job.load_scene()? }.scene;
        // Its image takes time to read, and contains no object.
        let mut job = job.clone();
        job.environment = None;
        job.apply_overrides(&mut scene)?;
        Ok(scene.instances.into_iter().filter(|object| !object.meshes.is_empty()).map(|object| object.name).collect())
    }

    /// The materials of the scene files with the changes of the job, without a build: with the textures that the project
    /// leaves out.
    ///
    /// # Errors
    /// A project that was opened without [`ProjectOptions::can_change`](super::ProjectOptions::can_change).
    pub fn described_materials(&self) -> Result<Vec<Material>, Error> {
        let description = self.description.as_deref().ok_or_else(not_kept)?;
        let mut scene = description.imported.scene.clone();
        // Its image takes time to read, and is no material.
        let mut job = (*self.job).clone();
        job.environment = None;
        job.apply_overrides(&mut scene)?;
        Ok(scene.materials)
    }

    /// The size of a unit of the vertices of an object along its three axes \[m\], after the import and before the job
    /// changes the object: by the unit of its file and the scales of its nodes. A copy `part 3` has that of `part`. 1 for
    /// objects that the scene files do not have, and along axes without an extent.
    pub fn imported_scale_of(&self, name: &str) -> DVec3 {
        let Some(description) = self.description.as_deref() else { return DVec3::ONE };
        let objects = &description.imported.scene.instances;
        let without_number = |name: &str| {
            let (rest, number) = name.rsplit_once(' ')?;
            number.bytes().all(|b| b.is_ascii_digit()).then(|| rest.to_owned())
        };
        let names = std::iter::successors(Some(name.to_owned()), |name| without_number(name));
        let found = names.filter_map(|name| objects.iter().find(|object| object.name == name)).next();
        let length = |axis: DVec3| Some(axis.length()).filter(|v| *v > 0.0 && v.is_finite()).unwrap_or(1.0);
        found.map_or(DVec3::ONE, |object| {
            let axes = &object.to_world.matrix3;
            DVec3::new(length(axes.x_axis), length(axes.y_axis), length(axes.z_axis))
        })
    }

    fn change_to(
        &mut self,
        changed: Job,
        edit: impl FnOnce(&mut SceneBuilder) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let description = self.description.as_deref_mut().ok_or_else(not_kept)?;
        let Description { imported, without, cache, .. } = description;
        let read = if changed.has_scene_of(&self.job) { None } else { Some(changed.load_scene()?) };
        let source = read.as_ref().unwrap_or(imported).clone();
        let options = (without.as_slice(), self.settings.run.threads);
        let Compiled { scene, report, mut setup, .. } = compile_and(&changed, source, options, Some(cache), edit)?;
        if let Some(read) = read {
            *imported = read;
        }
        setup.inputs.extend(&self.inputs);
        (self.scene, self.report) = (scene, report);
        self.has_all_findings = false;
        self.set_up(setup);
        Ok(())
    }
}

fn not_kept() -> Error {
    Error::setting(
        "overrides",
        "the description of the scene was not kept",
        "open the project with `ProjectOptions::can_change`, from a path in UTF-8",
    )
}
