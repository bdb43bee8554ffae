//! Record of a path for replay: the events at each vertex.

use crate::mnee::ConnectionRecord;
use crate::vertex::Scattering;
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::Chain;
use std::time::Instant;

/// One vertex of a recorded path.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceVertex {
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
    /// The sampled direction in which the path continued; `None` where the path ended.
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
    /// The vertices in order, starting at the camera.
    pub vertices: Vec<TraceVertex>,
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
    /// Time at which a path of very many vertices is abandoned.
    pub abandon_at: Option<Instant>,
    /// Was a path abandoned? Its sample is invalid and must not be used.
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

/// Receiver of the events of a path. By default it ignores them, and then they cost nothing.
pub(crate) trait Recorder {
    /// True if no shadow ray and no connection is left out by roulette, so that each has an outcome.
    const TRAINING: bool = false;

    /// Is the path to be abandoned? It is asked rarely.
    #[inline]
    fn abandons(&mut self) -> bool {
        false
    }
    /// The path has reached a vertex.
    #[inline]
    fn vertex(&mut self, _position: [f32; 3], _material: Option<u32>, _throughput: Rgb) {}
    /// The path has reached a vertex in the medium of a material.
    #[inline]
    fn medium_vertex(&mut self, _position: [f32; 3], _material: Option<u32>, _throughput: Rgb) {}
    /// Emission was added at the current vertex.
    #[inline]
    fn add_emitted(&mut self, _contribution: Rgb) {}
    /// Direct light was added at the current vertex.
    #[inline]
    fn add_direct(&mut self, _contribution: Rgb) {}
    /// The path continues in this direction, with this throughput.
    #[inline]
    fn scattering(&mut self, _scattering: &Scattering, _throughput: Rgb) {}
    /// A shadow ray of the light sample with this index was traced. `arrived` is false if it was occluded.
    #[inline]
    fn shadow_ray(&mut self, _index: u32, _arrived: bool) {}
    /// A connection of the light sample with this index was attempted. `arrived` is false if it reached no light.
    #[inline]
    fn connection_outcome(&mut self, _index: u32, _arrived: bool) {}
    /// A connection through a cover was attempted at the current vertex.
    #[inline]
    fn connection(&mut self, _record: &ConnectionRecord) {}
    /// The last connection reached the light and has this MIS weight.
    #[inline]
    fn connection_mis_weight(&mut self, _mis_weight: f32) {}
    /// Light of the last connection was added at the current vertex. Nothing is recorded if the light sample had no
    /// connection.
    #[inline]
    fn add_connection(&mut self, _contribution: Rgb) {}
    /// The path has ended. All contributions are multiplied by this factor, the weight of the lens.
    #[inline]
    fn scale(&mut self, _factor: f32) {}
}

/// Nothing is recorded.
impl Recorder for () {}

impl Recorder for ConnectionTally {
    #[inline]
    fn abandons(&mut self) -> bool {
        self.is_abandoned = self.abandon_at.is_some_and(|at| Instant::now() > at);
        self.is_abandoned
    }
    #[inline]
    fn connection(&mut self, record: &ConnectionRecord) {
        self.attempts += 1;
        self.converged += u64::from(record.has_converged);
        self.rays += u64::from(record.rays);
    }
}

impl Recorder for PathTrace {
    fn vertex(&mut self, position: [f32; 3], material: Option<u32>, throughput: Rgb) {
        self.vertices.push(TraceVertex {
            position,
            material,
            in_medium: false,
            throughput,
            emitted: Rgb::BLACK,
            direct: Rgb::BLACK,
            connections: Vec::new(),
            scattered: None,
        });
    }

    fn medium_vertex(&mut self, position: [f32; 3], material: Option<u32>, throughput: Rgb) {
        self.vertex(position, material, throughput);
        if let Some(v) = self.vertices.last_mut() {
            v.in_medium = true;
        }
    }

    fn add_emitted(&mut self, contribution: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            v.emitted += contribution;
        }
    }

    fn add_direct(&mut self, contribution: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            v.direct += contribution;
        }
    }

    fn scattering(&mut self, s: &Scattering, _: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            let (direction, pdf, weight, lobe) = (s.wi.to_array(), s.pdf, s.weight, s.lobe);
            v.scattered = Some(TraceScattering { direction, pdf, weight, lobe });
        }
    }

    fn connection(&mut self, s: &ConnectionRecord) {
        if let Some(v) = self.vertices.last_mut() {
            v.connections.push(TraceConnection {
                cover: s.stack,
                chain: s.chain,
                probability: s.probability,
                rays: s.rays,
                has_converged: s.has_converged,
                mis_weight: 0.0,
                contribution: Rgb::BLACK,
            });
        }
    }

    fn connection_mis_weight(&mut self, mis_weight: f32) {
        if let Some(c) = self.last_connection() {
            c.mis_weight = mis_weight;
        }
    }

    fn add_connection(&mut self, contribution: Rgb) {
        // A light sample without any chain adds no connection, and its contribution is black.
        if let Some(c) = self.last_connection() {
            c.contribution += contribution;
        }
    }

    fn scale(&mut self, factor: f32) {
        for v in &mut self.vertices {
            v.throughput *= factor;
            v.emitted *= factor;
            v.direct *= factor;
            for c in &mut v.connections {
                c.contribution *= factor;
            }
        }
    }
}

impl PathTrace {
    fn last_connection(&mut self) -> Option<&mut TraceConnection> {
        self.vertices.last_mut()?.connections.last_mut()
    }
}
