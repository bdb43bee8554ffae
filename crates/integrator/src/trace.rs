//! A path written down, for replay: what happened at each vertex.

use crate::cover::Effort;
use dunkelfeld_radiometry::Rgb;

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
    /// What next-event estimation added here [W/(m^2 sr)].
    pub direct: Rgb,
    /// The sampled direction, its density [1/sr] (probability for a delta lobe) and weight; `None` where the path ended.
    pub scattered: Option<([f32; 3], f32, Rgb)>,
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
    fn scattered(&mut self, direction: [f32; 3], pdf: f32, weight: Rgb);
    /// A connection through a cover was sought at the current vertex.
    fn connection(&mut self, effort: Effort);
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
    fn scattered(&mut self, _: [f32; 3], _: f32, _: Rgb) {}
    #[inline]
    fn connection(&mut self, effort: Effort) {
        self.attempts += 1;
        self.arrived += u64::from(effort.has_arrived);
        self.shots += u64::from(effort.shots);
    }
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

    fn scattered(&mut self, direction: [f32; 3], pdf: f32, weight: Rgb) {
        if let Some(v) = self.vertices.last_mut() {
            v.scattered = Some((direction, pdf, weight));
        }
    }

    fn connection(&mut self, _: Effort) {}

    fn weigh(&mut self, factor: f32) {
        for v in &mut self.vertices {
            v.throughput *= factor;
            v.emitted *= factor;
            v.direct *= factor;
        }
    }
}
