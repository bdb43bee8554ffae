//! Events of paths, and their record for replay.

use dunkelfeld_bsdf::Lobe;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::Chain;
use std::time::Instant;

/// Receives the events of paths. They are numbered from 0, in the order of their samples, then those split from them.
pub(crate) trait Observer {
    /// True if no shadow ray and no connection is left out by roulette, so that each has an outcome.
    fn needs_outcomes(&self) -> bool {
        false
    }
    /// An event at the last vertex of a path, or the next vertex.
    fn event(&mut self, path: usize, event: Event);
}

/// An event of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Event {
    /// The path has reached a vertex. Without a material the ray left the scene, and its position is its direction.
    Vertex { position: Vec3, material: Option<u32>, in_medium: bool, throughput: Rgb },
    /// The path was split from another one at that one's last vertex.
    Split { parent: u32 },
    /// Emission was added.
    Emitted(Rgb),
    /// The shadow ray of the light sample with this index was traced. It has added this light.
    ShadowRay { index: u32, light: Rgb },
    /// A connection of the light sample with this index was attempted.
    Connection { index: u32, connection: TraceConnection },
    /// The path continues in a direction, with this throughput.
    Scattered { scattering: TraceScattering, throughput: Rgb },
}

/// One vertex of a recorded path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TraceVertex {
    /// Index of the vertex before it; `None` for the first. A vertex where the path was split is before several others.
    pub before: Option<usize>,
    /// Position in render space \[m\].
    pub position: [f32; 3],
    /// Index of the material; `None` when the ray left the scene.
    pub material: Option<u32>,
    /// True if the vertex lies inside the medium of the material, false if it lies on a surface.
    pub in_medium: bool,
    /// Path throughput before this vertex.
    pub throughput: Rgb,
    /// Emission of the surface (or of the environment) that was added to the sample at this vertex [W/(m^2 sr)].
    pub emitted: Rgb,
    /// Light of next-event estimation along straight lines that was added at this vertex [W/(m^2 sr)].
    pub direct: Rgb,
    /// The connections through covers that were attempted here. There is at most one for each light sample.
    pub connections: Vec<TraceConnection>,
    /// The sampled direction in which the path continued, where it was split that of its first part that goes on; `None`
    /// where it ended.
    pub scattered: Option<TraceScattering>,
}

impl TraceVertex {
    /// Total contribution of this vertex [W/(m^2 sr)]. The radiance of the sample is the sum over its vertices.
    pub fn contribution(&self) -> Rgb {
        self.connections.iter().fold(self.emitted + self.direct, |sum, c| sum + c.contribution)
    }
}

/// A direction that was sampled at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceScattering {
    /// Unit direction in render space.
    pub direction: [f32; 3],
    /// Its density [1/sr]; for a delta lobe its probability.
    pub pdf: f32,
    /// Scattered radiance over the density: BSDF (or phase function) times cosine over pdf.
    pub weight: Rgb,
    /// The lobe from which the direction was drawn; empty for the phase function of a medium.
    pub lobe: Lobe,
}

/// A connection through a cover that was attempted at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceConnection {
    /// Index of the cover in the list of the scene.
    pub cover: u16,
    /// The events at the interfaces, from the vertex to the light.
    pub chain: Chain,
    /// The probability with which this chain was chosen among all candidate chains to the light.
    pub probability: f32,
    /// Number of rays that were traced through the cover.
    pub rays: u32,
    /// True if the solver found the chain.
    pub has_converged: bool,
    /// Weight of the connection by the power heuristic. Scattering has the rest. It is 0 if no chain was found or if
    /// the chain is occluded.
    pub mis_weight: f32,
    /// Radiance that the connection added [W/(m^2 sr)].
    pub contribution: Rgb,
}

/// A recorded path, vertex by vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathTrace {
    /// The vertices, starting at the camera. Each comes after the one before it on its path.
    pub vertices: Vec<TraceVertex>,
    /// Index of the last vertex of each path that the sample was split into.
    last: Vec<Option<usize>>,
}

/// Numbers of attempted connections through covers, of solved chains and of traced rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConnectionTally {
    /// Number of attempted connections.
    pub attempts: u64,
    /// Number of connections whose chain was found.
    pub converged: u64,
    /// Number of rays traced through covers for all connections. A plate needs one ray for each connection.
    pub rays: u64,
    /// Time at which paths are abandoned.
    pub abandon_at: Option<Instant>,
    /// Were paths abandoned? The samples of their batch are left out.
    pub is_abandoned: bool,
}

impl ConnectionTally {
    /// Adds another tally.
    pub fn add(&mut self, other: &Self) {
        self.attempts += other.attempts;
        self.converged += other.converged;
        self.rays += other.rays;
    }
}

impl Observer for PathTrace {
    fn event(&mut self, path: usize, event: Event) {
        if path >= self.last.len() {
            self.last.resize(path + 1, None);
        }
        match event {
            Event::Split { parent } => self.last[path] = self.last[parent as usize],
            Event::Vertex { position, material, in_medium, throughput } => {
                let before = self.last[path].replace(self.vertices.len());
                let (position, rest) = (position.to_array(), TraceVertex::default());
                self.vertices.push(TraceVertex { before, position, material, in_medium, throughput, ..rest });
            }
            _ => {}
        }
        let Some(vertex) = self.last[path].and_then(|last| self.vertices.get_mut(last)) else { return };
        match event {
            Event::Split { .. } | Event::Vertex { .. } => {}
            Event::Emitted(light) => vertex.emitted += light,
            Event::ShadowRay { light, .. } => vertex.direct += light,
            Event::Connection { connection, .. } => vertex.connections.push(connection),
            Event::Scattered { scattering, .. } => _ = vertex.scattered.get_or_insert(scattering),
        }
    }
}

impl PathTrace {
    /// Multiplies all contributions by the weight of the lens.
    pub(crate) fn scale(&mut self, factor: f32) {
        for v in &mut self.vertices {
            v.throughput *= factor;
            v.emitted *= factor;
            v.direct *= factor;
            v.connections.iter_mut().for_each(|c| c.contribution *= factor);
        }
    }
}
