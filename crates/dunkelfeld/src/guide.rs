//! From pixels to arrays: one example for each task. All of them run as tests.
//!
//! Planes ([`film::Plane`](crate::film::Plane)) are row-major, row 0 at the top: the value of pixel (x, y) is
//! `data()[y * width + x]`. [`Plane::into_vec`](crate::film::Plane::into_vec) gives the buffer away without a copy.
//!
//! | quantity | where | type | unit |
//! |---|---|---|---|
//! | mean radiance | [`Film::mean`](crate::film::Film::mean) | `Plane<[f32; 3]>`, linear Rec. 709 | W/(m² sr) |
//! | variance of the mean | [`Film::variance`](crate::film::Film::variance) | `Plane<[f32; 3]>` | its square |
//! | samples | [`Film::sample_counts`](crate::film::Film::sample_counts) | `Plane<u32>` | 1 |
//! | object and material | [`RenderedFilm::ids`](crate::RenderedFilm) | `Plane<Option<PixelIds>>` | indices |
//! | depth, normal, albedo | [`Film::map`](crate::film::Film::map) of [`PixelSums`](crate::film::PixelSums) | any | m, 1, 1 |
//! | expected electrons | [`Exposer::electrons`](crate::Exposer::electrons) | `Plane<f32>` | electrons |
//! | grey values | [`Exposer::frame`](crate::Exposer::frame) | `Plane<u16>` | DN |
//! | 8-bit picture | [`Exposer::picture`](crate::Exposer::picture) | [`Picture`](crate::Picture), gamma 2.2 | |
//!
//! # Render, and read the arrays
//!
//! ```
//! use dunkelfeld::Project;
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let mut project = Project::from_text("ball.toml", JOB)?; // or Project::open("scene.glb")
//! project.settings.budget.spp = Some(8.0);
//! let result = project.render()?; // writes no file
//! let film = &result.rendering.film;
//! let radiance: Vec<[f32; 3]> = film.sums.mean().into_vec();
//! let depth: Vec<f32> = film.sums.map(|sums| sums.mean_depth()).into_vec();
//! assert_eq!((radiance.len(), depth.len()), (32 * 24, 32 * 24));
//! // The name of the object in the middle of the image.
//! let ids = film.ids.at(16, 12).expect("the ball");
//! assert_eq!(film.object_names[ids.object() as usize], "ball");
//! // The grey values of the frame.
//! let sensor = result.frame.sensor.as_ref().expect("the default sensor");
//! assert_eq!(sensor.values.data().len(), 32 * 24);
//! # Ok(())
//! # }
//! ```
//!
//! # Expose a film again: other times, frames and sensors
//!
//! ```
//! use dunkelfeld::radiometry::Seconds;
//! use dunkelfeld::sensor::Exposure;
//! use dunkelfeld::{ExposeSettings, Exposer, Project, find_sensor};
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let result = Project::from_text("ball.toml", JOB)?.render()?;
//! let film = &result.rendering.film;
//! let settings = ExposeSettings::of_render(result.settings())?.expect("a sensor");
//! // Frame 0 is that of the render. Later frames have the same fixed pattern and other noise.
//! let exposer = Exposer::of_film(film, &settings)?;
//! assert_eq!(exposer.frame(0)?, result.frame.sensor.as_ref().expect("a sensor").values);
//! assert_ne!(exposer.frame(1)?, exposer.frame(0)?);
//! let short = Exposer::of_film(film, &settings.clone().with_exposure(Exposure::new(Seconds(1e-4))?))?;
//! assert!(short.electrons().at(16, 12) < exposer.electrons().at(16, 12));
//! let other = Exposer::of_film(film, &ExposeSettings::new(find_sensor("imx174")?)?)?;
//! assert!(other.model().spec().name.contains("IMX174"));
//! # Ok(())
//! # }
//! ```
//!
//! # The same samples again, and one of them vertex by vertex
//!
//! [`save_film_files`](crate::outputs::save_film_files) writes the files of the program, and with them the plan for `--replay`.
//!
//! ```
//! use dunkelfeld::trace::PixelSample;
//! use dunkelfeld::outputs::SavedPlan;
//! use dunkelfeld::{Cancel, Project, RenderOptions, ReplayOption, Silent};
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let mut project = Project::from_text("ball.toml", JOB)?;
//! let options = RenderOptions::default().with_keys("budget.spp = 8\nseed = 3");
//! let film = project.render_options(options, &Silent, &Cancel::new())?.into_saved_film();
//! // Size, seed and frame belong to the plan.
//! let replay = RenderOptions::default().with_replay(ReplayOption::Plan(SavedPlan::of_film(&film)?));
//! let again = project.render_options(replay, &Silent, &Cancel::new())?;
//! assert!(again.rendering.film.sums == film.film.sums);
//! let sample = project.trace_sample(PixelSample { x: 16, y: 12, index: 0 })?;
//! assert!(sample.is_valid && sample.vertices[0].material.is_some());
//! # Ok(())
//! # }
//! ```
//!
//! # Poses, materials and lights: change the scene and render again
//!
//! The text of [`Project::set_overrides`](crate::Project::set_overrides) has the keys of a job file. Only the parts that
//! change are built again.
//!
//! ```
//! use dunkelfeld::Project;
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let mut project = Project::from_text("ball.toml", JOB)?;
//! let mut frames = Vec::new();
//! for x in 0..3 {
//!     project.set_overrides(&format!("[[object]]\nname = 'ball'\ntranslate = ['{x}mm', 0, 0]\n"))?;
//!     frames.push(project.render()?.frame.picture);
//! }
//! assert!(frames[0] != frames[1] && frames[1] != frames[2]);
//! project.set_overrides("[[object]]\nname = 'ball'\nvisible = false\n[[material]]\nname = 'floor'\nroughness = 0.2\n")?;
//! # Ok(())
//! # }
//! ```
//!
//! # A scene in code
//!
//! ```
//! use dunkelfeld::geometry::{DAffine3, DVec3, Vec3};
//! use dunkelfeld::radiometry::Rgb;
//! use dunkelfeld::scene::{BuildCache, Material, SceneBuilder, shapes};
//! use dunkelfeld::{Budget, Session, default_settings, develop_film, render};
//! # fn main() -> Result<(), dunkelfeld::Error> {
//! let mut scene = SceneBuilder::default();
//! let white = scene.add_material(Material::default());
//! let lamp = scene.add_material(Material { emission: Rgb::WHITE.into(), ..Material::default()  });
//! let part = scene.add_object("part", shapes::cuboid(Vec3::splat(-0.05), Vec3::splat(0.05)), white);
//! scene.add_object("lamp", shapes::rectangle(Vec3::new(-0.5, 1.0, -0.5), Vec3::X, Vec3::Z), lamp);
//! scene.add_camera("above", DVec3::new(0.1, 0.5, 0.3), DVec3::ZERO, 0.5);
//! let settings = default_settings().with_width(16).with_height(16).with_budget(Budget::default().with_spp(4.0));
//! let session = Session::new(settings.run.threads)?;
//! // The cache keeps what does not change from build to build.
//! let mut cache = BuildCache::default();
//! for step in 0..3 {
//!     scene.instances[part].to_world = DAffine3::from_translation(DVec3::X * 0.01 * f64::from(step));
//!     let (compiled, report) = scene.clone().build_with(&mut cache)?;
//!     assert!(report.hazards().next().is_none());
//!     let rendering = render(&compiled, &settings, &session)?;
//!     let frame = session.install(|| develop_film(&rendering.film, &settings))?;
//!     assert!(frame.sensor.is_some());
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Progress, and an early end
//!
//! ```
//! use dunkelfeld::{Cancel, Progress, ProgressState, Project};
//! struct Half<'a>(&'a Cancel);
//! impl Progress for Half<'_> {
//!     fn update(&self, state: &ProgressState) {
//!         if state.fraction >= 0.5 {
//!             self.0.cancel();
//!         }
//!     }
//! }
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let cancel = Cancel::new();
//! let result = Project::from_text("ball.toml", JOB)?.render_with(&Half(&cancel), &cancel)?;
//! assert!(result.rendering.film.sums.total_samples() > 0, "the samples until then are kept");
//! # Ok(())
//! # }
//! ```
//!
//! # Certificate and denoiser
//!
//! ```
//! use dunkelfeld::{DenoiseMethod, Project};
//! # fn main() -> Result<(), dunkelfeld::Error> {
#![doc = include_str!("guide/job.md")]
//! let mut project = Project::from_text("ball.toml", JOB)?;
//! project.settings.denoise.method = DenoiseMethod::Builtin;
//! let result = project.render()?;
//! // The share of pixels whose render noise is below the noise of the sensor.
//! let certified = result.frame.sensor.as_ref().and_then(|sensor| sensor.certified.as_ref()).expect("a sensor");
//! assert!((0.0..=1.0).contains(&certified.certificate.hidden));
//! let denoised = result.frame.denoised.as_ref().expect("a denoised mean");
//! assert_eq!(denoised.mean.data().len(), 32 * 24);
//! # Ok(())
//! # }
//! ```
