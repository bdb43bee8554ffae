//! One sample of a project, vertex by vertex: the data of `--debug-sample`.

use crate::project::Project;
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_integrator::{Estimator, PixelSample, TraceConnection, TraceVertex};
use dunkelfeld_render::{Error, Session, camera, train};
use serde::Serialize;

/// A sample that was traced as a render does. Its radiance is the sum of `emitted`, `direct` and the contributions of the
/// connections over its vertices, up to rounding.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TracedSample {
    /// Radiance [W/(m^2 sr)], linear Rec. 709.
    pub radiance: [f32; 3],
    /// Is it finite, not negative, and in the range of a film?
    pub is_valid: bool,
    /// The vertices, starting at the camera. Each comes after the one before it on its path.
    pub vertices: Vec<TracedVertex>,
}

/// A vertex of a traced sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TracedVertex {
    /// Index of the vertex before it; `None` for the first. Where the path was split, several have the same.
    pub before: Option<usize>,
    /// Name of the material; `None` where the ray left the scene.
    pub material: Option<String>,
    /// Position in world space \[m\]; `None` where the ray left the scene.
    pub position: Option<[f64; 3]>,
    /// Unit vector in world space in which the ray left the scene; `None` elsewhere.
    pub left_toward: Option<[f32; 3]>,
    /// Is the vertex inside the medium of the material, not on a surface?
    pub in_medium: bool,
    /// Throughput of the path before this vertex.
    pub throughput: [f32; 3],
    /// Emission of the surface or of the environment that was added [W/(m^2 sr)].
    pub emitted: [f32; 3],
    /// Light of next-event estimation along straight lines that was added [W/(m^2 sr)].
    pub direct: [f32; 3],
    /// Attempted connections through covers.
    pub connections: Vec<TracedConnection>,
    /// The direction in which the path continued; `None` where it ended.
    pub scattered: Option<TracedScattering>,
}

/// A connection to a light through a cover.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TracedConnection {
    /// The events at the interfaces, from the vertex to the light.
    pub chain: String,
    /// Index of the cover in the list of the scene.
    pub cover: u16,
    /// Probability with which the chain was chosen among all candidates.
    pub probability: f32,
    /// Number of rays that were traced through the cover.
    pub rays: u32,
    /// Did the solver find the chain?
    pub has_converged: bool,
    /// Weight of the connection by the power heuristic; 0 where no light comes through.
    pub mis_weight: f32,
    /// Radiance that was added [W/(m^2 sr)].
    pub contribution: [f32; 3],
}

/// A sampled direction.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TracedScattering {
    /// Unit vector in world space.
    pub direction: [f32; 3],
    /// The lobe, as in `delta transmission`; `phase function` in a medium.
    pub lobe: String,
    /// Density of the direction [1/sr]; of a delta lobe its probability.
    pub pdf: f32,
    /// Scattered radiance over the density.
    pub weight: [f32; 3],
}

impl Project {
    /// Traces one sample as a render with the present settings does, and records its path.
    ///
    /// # Errors
    /// Those of [`Project::fitted`], and a pixel outside of the film.
    pub fn trace_sample(&self, at: PixelSample) -> Result<TracedSample, Error> {
        let mut settings = self.fitted()?;
        // A time limit decides whether a render has training.
        settings.budget.seconds = None;
        if at.x >= settings.width || at.y >= settings.height {
            let problem = format!("pixel {},{} is outside {} x {}", at.x, at.y, settings.width, settings.height);
            return Err(Error::setting("sample", problem, "name a pixel of the image; the first is 0,0"));
        }
        let scene = &self.scene;
        let camera = camera(scene, &settings)?;
        let roulette = Session::new(settings.run.threads)?.install(|| train(scene, &camera, &settings));
        let (width, seed, frame) = (settings.width, settings.seed, settings.frame);
        let estimator = Estimator { scene, camera: &camera, width, seed, frame, roulette: roulette.as_ref() };
        let (sample, trace) = estimator.trace(at);
        let vertices = trace.vertices.iter().map(|vertex| self.described(vertex)).collect();
        Ok(TracedSample { radiance: sample.radiance.to_array(), is_valid: sample.is_valid(), vertices })
    }

    fn described(&self, vertex: &TraceVertex) -> TracedVertex {
        let (materials, origin) = (self.scene.materials(), self.scene.world_origin());
        let name = |m: u32| materials.get(m as usize).map_or("?", |m| m.name.as_str()).to_owned();
        let place = [0, 1, 2].map(|axis| f64::from(vertex.position[axis]) + origin[axis]);
        TracedVertex {
            before: vertex.before,
            material: vertex.material.map(name),
            position: vertex.material.map(|_| place),
            left_toward: if vertex.material.is_none() { Some(vertex.position) } else { None },
            in_medium: vertex.in_medium,
            throughput: vertex.throughput.to_array(),
            emitted: vertex.emitted.to_array(),
            direct: vertex.direct.to_array(),
            connections: vertex.connections.iter().map(TracedConnection::new).collect(),
            scattered: vertex.scattered.map(|s| TracedScattering {
                direction: s.direction,
                lobe: lobe_name(s.lobe),
                pdf: s.pdf,
                weight: s.weight.to_array(),
            }),
        }
    }
}

impl TracedConnection {
    fn new(connection: &TraceConnection) -> Self {
        let TraceConnection { cover, chain, probability, rays, has_converged, mis_weight, contribution } = *connection;
        let (chain, contribution) = (format!("{chain:?}"), contribution.to_array());
        Self { chain, cover, probability, rays, has_converged, mis_weight, contribution }
    }
}

/// The name of the lobe that a direction was drawn from.
fn lobe_name(lobe: Lobe) -> String {
    let words = [
        (Lobe::CLEARCOAT, "clearcoat"),
        (Lobe::DIFFUSE, "diffuse"),
        (Lobe::GLOSSY, "glossy"),
        (Lobe::DELTA, "delta"),
        (Lobe::REFLECTION, "reflection"),
        (Lobe::TRANSMISSION, "transmission"),
    ];
    let words: Vec<&str> = words.iter().filter(|(l, _)| lobe.contains(*l)).map(|(_, word)| *word).collect();
    if words.is_empty() { "phase function".into() } else { words.join(" ") }
}
