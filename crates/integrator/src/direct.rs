//! Next-event estimation along straight lines from a vertex to a light.

use crate::learned_roulette::VertexRoulette;
use crate::mnee::SpecularPrefix;
use crate::recorder::Recorder;
use crate::vertex::Vertex;
use dunkelfeld_lanes::{Lanes, Mask};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Features, LightChoice, LightSample, LightSampleContext, Scene};

/// The last vertex at which light sampling and scattering could both have sampled a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastScatter {
    pub(crate) receiver: LightSampleContext,
    /// The choice of lights at that vertex.
    pub(crate) choice: LightChoice,
    /// Density of the sampled direction [1/sr].
    pub(crate) pdf: f32,
    /// The smooth interfaces of covers that the path has passed since then; `None` in scenes without covers.
    pub(crate) specular_prefix: Option<SpecularPrefix>,
}

/// Russian roulette on a shadow ray or a connection, before it is traced (Veach 1997, section 10.4).
#[derive(Clone, Copy, Debug)]
pub(crate) enum ShadowRoulette<'a> {
    /// Every ray is traced.
    Off,
    /// A light sample that would add almost nothing to the radiance gathered so far is traced with a probability in
    /// proportion to its contribution, and its weight increases accordingly. Without it, most shadow rays of long paths
    /// would be traced for such samples.
    Gathered {
        /// Largest channel of the throughput, over the limit of the roulette: [`Self::THRESHOLD`] times the largest
        /// channel of the gathered radiance \[m^2 sr/W\].
        scale: f32,
        /// A number in `[0, 1)` for one light sample only.
        u: f32,
    },
    /// The probability follows from training paths.
    Learned {
        /// The statistics at the vertex.
        vertex: VertexRoulette<'a>,
        /// Index of the light sample.
        index: u32,
        /// Largest channel of the throughput.
        throughput: f32,
        /// A number in `[0, 1)` for one light sample only.
        u: f32,
    },
}

impl ShadowRoulette<'_> {
    /// The roulette of [`Self::Gathered`] applies to contributions below this share of the gathered radiance f. It adds no more than (f /
    /// 32)^2 / 4 to the variance of a sample, which is little also where light is smooth. A limit at f itself would
    /// more than double the noise of matt rooms.
    pub(crate) const THRESHOLD: f32 = 1.0 / 32.0;

    /// The roulette for a path with the given `throughput` and the radiance `gathered` \[W/(m^2 sr)\] that it has
    /// gathered before this vertex.
    #[inline]
    pub(crate) fn from_gathered(throughput: Rgb, gathered: Rgb, u: impl FnOnce() -> f32) -> Self {
        let gathered = gathered.max_channel();
        let scale = throughput.max_channel() / (Self::THRESHOLD * gathered);
        // The scale of values that are infinite or not a number is not above 0.
        if gathered > 0.0 && scale > 0.0 { Self::Gathered { scale, u: u() } } else { Self::Off }
    }

    /// The survival probability of a shadow ray whose light sample has the expected contribution `light`
    /// \[W/(m^2 sr)\] at the vertex; `None` if the ray is not traced.
    #[inline]
    pub(crate) fn shadow_survival(&self, light: Rgb) -> Option<f32> {
        let (survival, u) = match *self {
            Self::Off => return Some(1.0),
            Self::Gathered { scale, u } => (gathered_survival(scale * light.max_channel()), u),
            Self::Learned { vertex, index, throughput, u } => {
                (vertex.shadow_survival(index, throughput * light.max_channel()), u)
            }
        };
        (u < survival).then_some(survival)
    }

    /// The survival probability of a connection through a cover, like [`Self::shadow_survival`].
    #[inline]
    pub(crate) fn connection_survival(&self, light: Rgb) -> Option<f32> {
        match *self {
            Self::Learned { vertex, index, throughput, u } => {
                let survival = vertex.connection_survival(index, throughput * light.max_channel());
                (u < survival).then_some(survival)
            }
            _ => self.shadow_survival(light),
        }
    }
}

/// Next-event estimation: light of a light sample that reaches a vertex on a straight line and is scattered toward the
/// camera.
#[inline]
pub(crate) fn estimate<F: Features, V: Vertex>(
    scene: &Scene,
    at: &V,
    light: &LightSample,
    index: u32,
    roulette: ShadowRoulette<'_>,
    recorder: &mut impl Recorder,
) -> Rgb {
    let (scattered, pdf) = at.eval(light.direction);
    let unoccluded = scattered * light.radiance;
    if unoccluded.is_black() {
        return Rgb::BLACK;
    }
    let expected = unoccluded * light_weight(light.pdf, pdf, light.is_delta);
    let Some(survival) = roulette.shadow_survival(expected) else { return Rgb::BLACK };
    let shadow_start = at.spawn_ray(light.direction);
    let ray = scene
        .shadow_ray_from(shadow_start.ray.origin, light.direction, light.target.as_ref())
        .at_time(shadow_start.ray.time);
    let (open, transmittance) = shadow_start.shadow_transmittance::<F>(scene, &ray);
    recorder.shadow_ray(index, open > 0.0 && !transmittance.is_black());
    if open == 0.0 {
        return Rgb::BLACK;
    }
    let arriving = expected * (open / survival);
    if F::SOLIDS { arriving * transmittance } else { arriving }
}

/// Factor on the light of a light sample with the density `light_pdf`: the MIS weight over the density. `pdf` is the
/// density with which scattering draws its direction; it draws no direction to a light without extent.
#[inline(always)]
pub(crate) fn light_weight<F: Lanes>(light_pdf: F, pdf: F, is_delta: F::Mask) -> F {
    is_delta.select(pdf.constant(1.0), power_heuristic(light_pdf, pdf)) / light_pdf
}

/// The survival probability of a light sample with a contribution of `relative` times the limit
/// ([`ShadowRoulette::Gathered`]). Samples that are not a number survive, so that the film can count them.
#[inline(always)]
pub(crate) fn gathered_survival<F: Lanes>(relative: F) -> F {
    /// It limits the weight of a sample.
    const MIN_SURVIVAL: f32 = 1.0 / 16.0;
    let one = relative.constant(1.0);
    relative.lt(one).select(relative.max(relative.constant(MIN_SURVIVAL)), one)
}

/// The power heuristic with exponent 2 (Veach & Guibas 1995): the weight of the technique with the density `pdf`.
#[inline(always)]
pub(crate) fn power_heuristic<F: Lanes>(pdf: F, other_pdf: F) -> F {
    let one = pdf.constant(1.0);
    // A ratio, so that squares of large densities do not overflow.
    let ratio = other_pdf / pdf;
    pdf.eq(pdf.constant(f32::INFINITY)).select(one, one / (ratio * ratio + 1.0))
}
