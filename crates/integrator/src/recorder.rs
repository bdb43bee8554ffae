//! A path written down, for replay: what happened at each vertex.

use crate::mnee::Search;
use crate::vertex::Scattering;
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::Chain;

/// One event of a path.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceVertex {
    /// Position in render space \[m\].
    pub position: [f32; 3],
    /// Index of the material; `None` when the ray left the scene.
    pub material: Option<u32>,
    /// Was it scattered inside the material's solid, not at a surface?
    pub in_medium: bool,
    /// Weight of the path before this vertex.
    pub throughput: Rgb,
    /// What the surface (or the environment) itself added to the sample [W/(m^2 sr)].
    pub emitted: Rgb,
    /// What next-event estimation in straight lines added here [W/(m^2 sr)].
    pub direct: Rgb,
    /// The connections through covers that were sought here, one for each question for light at most.
    pub connections: Vec<TraceConnection>,
    /// Where the path went on; `None` where it ended.
    pub scattered: Option<TraceScattering>,
}

impl TraceVertex {
    /// All that was found at this vertex [W/(m^2 sr)]; the sample's radiance is the sum over its vertices.
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
    /// What is scattered over the density.
    pub weight: Rgb,
    /// The lobe that it was drawn from; empty for the phase function of a medium.
    pub lobe: Lobe,
}

/// A connection through a cover that was sought at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceConnection {
    /// Index of the cover among those of the scene.
    pub cover: u16,
    /// What light does at the interfaces, from the vertex to the light.
    pub chain: Chain,
    /// The probability with which this chain was asked, of all that may lead to the light.
    pub probability: f32,
    /// Rays sent through the cover.
    pub shots: u32,
    /// Was the chain found?
    pub has_arrived: bool,
    /// The connection's share of what it found, by the power heuristic; scattering has the rest. 0 if nothing was found, or
    /// something stood in the way.
    pub share: f32,
    /// What it added [W/(m^2 sr)].
    pub contribution: Rgb,
}

/// A path, vertex by vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathTrace {
    /// The vertices, from the camera on.
    pub vertices: Vec<TraceVertex>,
}

/// Connections through covers that were sought, and how the solver fared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConnectionTally {
    /// Connections that were sought.
    pub attempts: u64,
    /// Those whose chain was found.
    pub arrived: u64,
    /// Rays sent through covers for all of them; a plate needs one each.
    pub shots: u64,
}

impl ConnectionTally {
    /// Adds another tally.
    pub fn add(&mut self, other: &Self) {
        self.attempts += other.attempts;
        self.arrived += other.arrived;
        self.shots += other.shots;
    }
}

/// Something that may listen to a path. A tally hears of connections only; the rest costs nothing.
pub(crate) trait Recorder {
    /// A vertex is reached.
    fn vertex(&mut self, position: [f32; 3], material: Option<u32>, throughput: Rgb);
    /// A vertex in the medium of a material is reached.
    fn medium(&mut self, position: [f32; 3], material: Option<u32>, throughput: Rgb);
    /// Emission was added at the current vertex.
    fn emitted(&mut self, contribution: Rgb);
    /// Direct light was added at the current vertex.
    fn direct(&mut self, contribution: Rgb);
    /// A direction was chosen at the current vertex.
    fn scattered(&mut self, scattering: &Scattering);
    /// A connection through a cover was sought at the current vertex.
    fn connection(&mut self, search: &Search);
    /// The last connection found light and has this share of it.
    fn shares(&mut self, share: f32);
    /// The last connection, if there was one for this question, added light at the current vertex.
    fn connected(&mut self, contribution: Rgb);
    /// The path is over; all that it found counts by this factor, the lens's.
    fn weigh(&mut self, factor: f32);
}

impl Recorder for ConnectionTally {
    #[inline]
    fn vertex(&mut self, _: [f32; 3], _: Option<u32>, _: Rgb) {}
    #[inline]
    fn medium(&mut self, _: [f32; 3], _: Option<u32>, _: Rgb) {}
    #[inline]
    fn emitted(&mut self, _: Rgb) {}
    #[inline]
    fn direct(&mut self, _: Rgb) {}
    #[inline]
    fn scattered(&mut self, _: &Scattering) {}
    #[inline]
    fn connection(&mut self, search: &Search) {
        self.attempts += 1;
        self.arrived += u64::from(search.has_arrived);
        self.shots += u64::from(search.shots);
    }
    #[inline]
    fn shares(&mut self, _: f32) {}
    #[inline]
    fn connected(&mut self, _: Rgb) {}
    #[inline]
    fn weigh(&mut self, _: f32) {}
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

    fn medium(&mut self, position: [f32; 3], material: Option<u32>, throughput: Rgb) {
        self.vertex(position, material, throughput);
        if let Some(v) = self.vertices.last_mut() {
            v.in_medium = true;
        }
    }

    fn emitted(&mut self, contribution: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            v.emitted += contribution;
        }
    }

    fn direct(&mut self, contribution: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            v.direct += contribution;
        }
    }

    fn scattered(&mut self, s: &Scattering) {
        if let Some(v) = self.vertices.last_mut() {
            let (direction, pdf, weight, lobe) = (s.wi.to_array(), s.pdf, s.weight, s.lobe);
            v.scattered = Some(TraceScattering { direction, pdf, weight, lobe });
        }
    }

    fn connection(&mut self, s: &Search) {
        if let Some(v) = self.vertices.last_mut() {
            v.connections.push(TraceConnection {
                cover: s.stack,
                chain: s.chain,
                probability: s.probability,
                shots: s.shots,
                has_arrived: s.has_arrived,
                share: 0.0,
                contribution: Rgb::BLACK,
            });
        }
    }

    fn shares(&mut self, share: f32) {
        if let Some(c) = self.last_connection() {
            c.share = share;
        }
    }

    fn connected(&mut self, contribution: Rgb) {
        // A question without any chain leaves no connection behind, and black.
        if let Some(c) = self.last_connection() {
            c.contribution += contribution;
        }
    }

    fn weigh(&mut self, factor: f32) {
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
