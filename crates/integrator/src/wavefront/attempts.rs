//! The connections through covers of a wave that are still to be searched.

use crate::mnee::{Endpoints, SEARCH_NUMBERS, Search};
use crate::ray_state::EnclosingSolids;
use crate::scatterer::Scattering;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, CandidateChains, Chain, Receivers, ShadingFrames, Targets};

/// What a connection depends on beside its chain, one for each lane.
pub(super) struct Entry<'g, F: Lanes> {
    pub(super) ends: Endpoints<F>,
    /// Radiance of the light sample times the throughput of the path, over the probability of survival.
    pub(super) light: Rgb<F>,
    /// Density of the light sample [1/sr].
    pub(super) pdf: F,
    pub(super) at: Scattering<'g, F>,
}

/// Connections of the paths of a wave: [`Entry`] and [`CandidateChains`], an array for each number.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    vectors: [[Vec<f32>; 3]; 13],
    numbers: [Vec<f32>; 3],
    masks: [Vec<f32>; 4],
    pub(super) searches: Searches,
    enclosing: Vec<EnclosingSolids>,
    chains: Vec<(u16, Chain)>,
    /// Numbers of the paths, and indices of the light samples.
    pub(super) paths: Vec<u32>,
    pub(super) indices: Vec<u32>,
    /// The BSDFs of receivers, and the one of each receiver.
    bsdfs: Vec<Bsdf>,
    bsdf: Vec<u32>,
}

/// The state of searches between two rays: an array for each number of [`Search`].
#[derive(Debug, Default)]
pub(super) struct Searches([Vec<f32>; SEARCH_NUMBERS]);

impl Searches {
    /// For so many connections.
    pub(super) fn resize(&mut self, count: usize) {
        self.0.iter_mut().for_each(|column| column.resize(count, 0.0));
    }

    /// The state of some searches. Before the first ray it is that of their chains.
    #[inline(always)]
    pub(super) fn load<F: Lanes>(&self, token: F::Token, numbers: &[u32], direction: V3<F>, ray: u32) -> Search<F> {
        let mut search = Search::new(token, direction);
        if ray > 1 {
            let (at, mut state) = (&in_lanes(numbers), search.to_numbers());
            for (number, column) in state.iter_mut().zip(&self.0) {
                *number = F::gather(token, column, at);
            }
            search = Search::from_numbers(state);
        }
        search
    }

    /// Stores the state of searches in some lanes, whose numbers are appended to `open`.
    #[inline(always)]
    pub(super) fn keep<F: Lanes>(&mut self, lanes: F::Mask, numbers: &[u32], search: &Search<F>, open: &mut Vec<u32>) {
        for (number, column) in search.to_numbers().into_iter().zip(&mut self.0) {
            let number = number.to_array();
            lanes.each(
                #[inline(always)]
                |lane| column[numbers[lane] as usize] = number[lane],
            );
        }
        lanes.each(
            #[inline(always)]
            |lane| open.push(numbers[lane]),
        );
    }
}

impl Attempts {
    /// Appends the connections of some lanes to a light sample.
    #[inline(always)]
    pub(super) fn append<F: Lanes>(
        &mut self,
        lanes: F::Mask,
        index: u32,
        (chains, entry): (&CandidateChains<F>, &Entry<'_, F>),
        paths: &[u32; MAX_WIDTH],
    ) {
        let Entry { ends, light, pdf, at } = entry;
        let Frame { tangent, bitangent, normal } = at.frames.frame;
        let vectors = [
            ends.receivers.point,
            ends.receivers.normal,
            ends.origin,
            ends.straight,
            ends.targets.point,
            ends.light_normal,
            chains.direction,
            tangent,
            bitangent,
            normal,
            at.frames.normal,
            at.wo,
            V3::new(light.r, light.g, light.b),
        ];
        let one = pdf.constant(1.0);
        let masks = [ends.receivers.both_sides, ends.targets.is_finite, at.frames.along, at.frames.is_bent];
        for ([to_x, to_y, to_z], V3 { x, y, z }) in self.vectors.iter_mut().zip(vectors) {
            x.append(lanes, to_x);
            y.append(lanes, to_y);
            z.append(lanes, to_z);
        }
        for (column, number) in self.numbers.iter_mut().zip([ends.time, *pdf, chains.probability]) {
            number.append(lanes, column);
        }
        for (column, mask) in self.masks.iter_mut().zip(masks) {
            one.only(mask).append(lanes, column);
        }
        let mut last = None;
        // Light samples of one receiver, and neighbours on one surface, share their BSDF.
        lanes.each(
            #[inline(always)]
            |lane| {
                self.enclosing.push(ends.enclosing[lane]);
                self.chains.push((chains.stack[lane], chains.chain[lane]));
                self.paths.push(paths[lane]);
                self.indices.push(index);
                let bsdf = at.bsdfs.lane(lane);
                if !last.is_some_and(|last| std::ptr::eq(last, bsdf)) {
                    if self.bsdfs.last() != Some(bsdf) {
                        self.bsdfs.push(*bsdf);
                    }
                    last = Some(bsdf);
                }
                self.bsdf.push(self.bsdfs.len() as u32 - 1);
            },
        );
    }

    /// Some connections. Free lanes repeat the first one.
    #[inline(always)]
    pub(super) fn load<F: Lanes>(&self, token: F::Token, numbers: &[u32]) -> (Entry<'_, F>, CandidateChains<F>) {
        let (len, places) = (numbers.len(), &in_lanes(numbers));
        let (mut stack, mut chain) = ([0; MAX_WIDTH], [Chain::EMPTY; MAX_WIDTH]);
        let mut enclosing = [EnclosingSolids::Last(None); MAX_WIDTH];
        let mut bsdfs = [&self.bsdfs[self.bsdf[places[0] as usize] as usize]; MAX_WIDTH];
        let mut is_same = true;
        for lane in 0..F::WIDTH {
            let number = places[lane] as usize;
            (stack[lane], chain[lane]) = self.chains[number];
            enclosing[lane] = self.enclosing[number];
            bsdfs[lane] = &self.bsdfs[self.bsdf[number] as usize];
            is_same &= self.bsdf[number] == self.bsdf[places[0] as usize];
        }
        let frame = Frame {
            tangent: self.vector::<F>(token, 7, places),
            bitangent: self.vector::<F>(token, 8, places),
            normal: self.vector::<F>(token, 9, places),
        };
        let frames = ShadingFrames {
            frame,
            normal: self.vector::<F>(token, 10, places),
            along: self.mask::<F>(token, 2, places),
            is_bent: self.mask::<F>(token, 3, places),
        };
        let (straight, light) = (self.vector::<F>(token, 3, places), self.vector::<F>(token, 12, places));
        let at = Scattering {
            token,
            len,
            frames,
            wo: self.vector::<F>(token, 11, places),
            bsdfs: if is_same { Bsdfs::Same(bsdfs[0]) } else { Bsdfs::Each(bsdfs) },
        };
        let ends = Endpoints {
            receivers: Receivers {
                point: self.vector::<F>(token, 0, places),
                normal: self.vector::<F>(token, 1, places),
                both_sides: self.mask::<F>(token, 0, places),
            },
            origin: self.vector::<F>(token, 2, places),
            time: F::gather(token, &self.numbers[0], places),
            enclosing,
            targets: Targets {
                point: self.vector::<F>(token, 4, places),
                direction: straight,
                is_finite: self.mask::<F>(token, 1, places),
            },
            light_normal: self.vector::<F>(token, 5, places),
            straight,
        };
        let probability = F::gather(token, &self.numbers[2], places);
        let chains = CandidateChains {
            is_some: F::mask(token, u32::MAX >> (32 - len)),
            stack,
            chain,
            direction: self.vector::<F>(token, 6, places),
            probability,
        };
        (
            Entry {
                ends,
                light: Rgb::new(light.x, light.y, light.z),
                pdf: F::gather(token, &self.numbers[1], places),
                at,
            },
            chains,
        )
    }

    #[inline(always)]
    fn vector<F: Lanes>(&self, token: F::Token, k: usize, at: &[u32; MAX_WIDTH]) -> V3<F> {
        let [x, y, z] = &self.vectors[k];
        V3::new(F::gather(token, x, at), F::gather(token, y, at), F::gather(token, z, at))
    }

    #[inline(always)]
    fn mask<F: Lanes>(&self, token: F::Token, k: usize, at: &[u32; MAX_WIDTH]) -> F::Mask {
        F::gather(token, &self.masks[k], at).is_positive()
    }

    /// The numbers of all connections, those of one light sample and of equally long chains together.
    pub(super) fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.paths.len() as u32).collect();
        order.sort_by_key(|&number| (self.indices[number as usize], self.chains[number as usize].1.events()));
        order
    }

    fn columns(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        self.vectors.iter_mut().flatten().chain(&mut self.numbers).chain(&mut self.masks)
    }

    pub(super) fn clear(&mut self) {
        self.columns().for_each(Vec::clear);
        let Self { enclosing, chains, paths, indices, bsdfs, bsdf, .. } = self;
        [paths, indices, bsdf].into_iter().for_each(Vec::clear);
        enclosing.clear();
        chains.clear();
        bsdfs.clear();
    }
}

/// Numbers of connections in lanes. Free lanes repeat the first one.
#[inline(always)]
fn in_lanes(numbers: &[u32]) -> [u32; MAX_WIDTH] {
    let mut at = [numbers[0]; MAX_WIDTH];
    at[..numbers.len()].copy_from_slice(numbers);
    at
}
