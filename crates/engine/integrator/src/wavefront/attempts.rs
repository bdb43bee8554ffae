//! The connections through covers of a wave that are still to be searched.

use crate::mnee::{Endpoints, Search, SearchRecord};
use crate::ray_state::EnclosingSolids;
use crate::scatterer::Scattering;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, CandidateChains, Chain, Receivers, ShadingFrames, Targets};

/// A connection of each lane, and all that it depends on.
pub(super) struct Entry<'g, F: Lanes> {
    pub(super) ends: Endpoints<F>,
    /// Index of the stack of each lane, and the chain with the probability of its choice.
    pub(super) chain: [(u16, Chain); MAX_WIDTH],
    pub(super) probability: F,
    /// Radiance of the light sample times the throughput of the path, over the probability of survival.
    pub(super) light: Rgb<F>,
    /// Density of the light sample [1/sr].
    pub(super) pdf: F,
    pub(super) at: Scattering<'g, F>,
}

/// Connections of the paths of a wave.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    connections: Vec<Connection>,
    /// The state of the searches between two rays.
    pub(super) searches: Vec<SearchRecord>,
    /// The BSDFs of the receivers.
    bsdfs: Vec<Bsdf>,
}

/// An [`Entry`] of one lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Connection {
    numbers: [[f32; 4]; 12],
    chain: (u16, Chain),
    enclosing: EnclosingSolids,
    /// Index of the BSDF of the receiver.
    bsdf: u32,
    /// Index of the light sample, and number of the path.
    pub(super) light: u32,
    pub(super) path: u32,
    /// The group of the light, if the light of groups is found.
    pub(super) group: u8,
}

impl Attempts {
    /// Appends the connections of some lanes to a light sample.
    #[inline(always)]
    pub(super) fn append<F: Lanes>(
        &mut self,
        lanes: F::Mask,
        (chosen, light): (&CandidateChains<F>, u32),
        entry: &Entry<'_, F>,
        (paths, groups): (&[u32; MAX_WIDTH], Option<&[u8; MAX_WIDTH]>),
    ) {
        let Entry { ends, chain, probability, light: Rgb { r, g, b }, pdf, at } = entry;
        let (Frame { tangent, bitangent, normal }, one) = (at.frames.frame, pdf.constant(1.0));
        let rows = [
            (ends.receivers.point, one.only(ends.receivers.both_sides)),
            (ends.receivers.normal, ends.time),
            (ends.origin, *pdf),
            (ends.targets.point, one.only(ends.targets.is_finite)),
            (ends.targets.direction, *probability),
            (ends.light_normal, one),
            (tangent, one.only(at.frames.along)),
            (bitangent, one.only(at.frames.is_bent)),
            (normal, one),
            (at.frames.normal, one),
            (at.wo, one),
            (V3::new(*r, *g, *b), one),
        ];
        let mut last: Option<&Bsdf> = None;
        V3::store_records(
            rows,
            lanes,
            #[inline(always)]
            |lane, numbers| {
                // Light samples of one receiver, and neighbours on one surface, share their BSDF.
                let own = at.bsdfs.lane(lane);
                if !last.is_some_and(|last| std::ptr::eq(last, own)) && self.bsdfs.last() != Some(own) {
                    self.bsdfs.push(*own);
                }
                last = Some(own);
                let (bsdf, enclosing) = (self.bsdfs.len() as u32 - 1, ends.enclosing[lane]);
                let (chain, path, group) = (chain[lane], paths[lane], groups.map_or(0, |groups| groups[lane]));
                self.connections.push(Connection { numbers, chain, enclosing, bsdf, light, path, group });
            },
        );
        V3::store_records(
            Search::new(one.token(), chosen.direction).to_rows(),
            lanes,
            #[inline(always)]
            |_, search| self.searches.push(search),
        );
    }

    /// Some connections. Free lanes repeat the first one.
    #[inline(always)]
    pub(super) fn load<F: Lanes>(&self, token: F::Token, numbers: &[u32]) -> Entry<'_, F> {
        let (len, numbers) = (numbers.len(), in_lanes(numbers));
        let mut chain = [(0, Chain::EMPTY); MAX_WIDTH];
        let mut enclosing = [EnclosingSolids::Last(None); MAX_WIDTH];
        let mut bsdfs = [&Bsdf::Absorber; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            let its = self.connection(numbers[lane]);
            (chain[lane], enclosing[lane]) = (its.chain, its.enclosing);
            bsdfs[lane] = &self.bsdfs[its.bsdf as usize];
        }
        let [
            (point, both_sides),
            (its_normal, time),
            (origin, pdf),
            (target, is_finite),
            (direction, probability),
            (light_normal, _),
            (tangent, along),
            (bitangent, is_bent),
            (normal, _),
            (geometric_normal, _),
            (wo, _),
            (light, _),
        ] = V3::<F>::load_records(
            token,
            #[inline(always)]
            |lane| &self.connection(numbers[lane]).numbers,
        );
        let receivers = Receivers { point, normal: its_normal, both_sides: both_sides.is_positive() };
        let targets = Targets { point: target, direction, is_finite: is_finite.is_positive() };
        let frames = ShadingFrames {
            frame: Frame { tangent, bitangent, normal },
            normal: geometric_normal,
            along: along.is_positive(),
            is_bent: is_bent.is_positive(),
        };
        let ends = Endpoints { receivers, origin, time, enclosing, targets, light_normal };
        let at = Scattering { token, len, frames, wo, bsdfs: Bsdfs::of_lanes(bsdfs, len) };
        Entry { ends, chain, probability, light: Rgb::new(light.x, light.y, light.z), pdf, at }
    }

    /// A connection by its number.
    #[inline(always)]
    pub(super) fn connection(&self, number: u32) -> &Connection {
        &self.connections[number as usize]
    }

    /// The numbers of all connections, those of one light sample and of equally long chains together.
    pub(super) fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.connections.len() as u32).collect();
        order.sort_by_key(|&number| (self.connection(number).light, self.connection(number).chain.1.events()));
        order
    }

    pub(super) fn clear(&mut self) {
        self.connections.clear();
        self.searches.clear();
        self.bsdfs.clear();
    }
}

/// Numbers of connections in lanes. Free lanes repeat the first one.
#[inline(always)]
pub(super) fn in_lanes(numbers: &[u32]) -> [u32; MAX_WIDTH] {
    let mut at = [numbers[0]; MAX_WIDTH];
    at[..numbers.len()].copy_from_slice(numbers);
    at
}
