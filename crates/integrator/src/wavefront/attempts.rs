//! The connections through covers of a wave that are still to be searched.

use crate::mnee::Endpoints;
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
    enclosing: Vec<EnclosingSolids>,
    chains: Vec<(u16, Chain)>,
    /// Numbers of the paths, and indices of the light samples.
    pub(super) paths: Vec<u32>,
    pub(super) indices: Vec<u32>,
    /// The BSDFs of receivers, and the one of each receiver.
    bsdfs: Vec<Bsdf>,
    bsdf: Vec<u32>,
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

    /// The connections of `lanes` from a place on. The numbers of free lanes are zero.
    #[inline(always)]
    pub(super) fn load<F: Lanes>(
        &self,
        token: F::Token,
        first: usize,
        lanes: F::Mask,
    ) -> (Entry<'_, F>, CandidateChains<F>) {
        let len = lanes.bits().count_ones() as usize;
        let (mut stack, mut chain) = ([0; MAX_WIDTH], [Chain::EMPTY; MAX_WIDTH]);
        let mut enclosing = [EnclosingSolids::Last(None); MAX_WIDTH];
        let mut bsdfs = [&self.bsdfs[self.bsdf[first] as usize]; MAX_WIDTH];
        let mut is_same = true;
        for lane in 0..len {
            (stack[lane], chain[lane]) = self.chains[first + lane];
            enclosing[lane] = self.enclosing[first + lane];
            bsdfs[lane] = &self.bsdfs[self.bsdf[first + lane] as usize];
            is_same &= self.bsdf[first + lane] == self.bsdf[first];
        }
        let frame = Frame {
            tangent: self.vector::<F>(token, 7, first),
            bitangent: self.vector::<F>(token, 8, first),
            normal: self.vector::<F>(token, 9, first),
        };
        let frames = ShadingFrames {
            frame,
            normal: self.vector::<F>(token, 10, first),
            along: self.mask::<F>(token, 2, first),
            is_bent: self.mask::<F>(token, 3, first),
        };
        let (straight, light) = (self.vector::<F>(token, 3, first), self.vector::<F>(token, 12, first));
        let at = Scattering {
            token,
            len,
            frames,
            wo: self.vector::<F>(token, 11, first),
            bsdfs: if is_same { Bsdfs::Same(bsdfs[0]) } else { Bsdfs::Each(bsdfs) },
        };
        let ends = Endpoints {
            receivers: Receivers {
                point: self.vector::<F>(token, 0, first),
                normal: self.vector::<F>(token, 1, first),
                both_sides: self.mask::<F>(token, 0, first),
            },
            origin: self.vector::<F>(token, 2, first),
            time: F::load(token, &self.numbers[0][first..]),
            enclosing,
            targets: Targets {
                point: self.vector::<F>(token, 4, first),
                direction: straight,
                is_finite: self.mask::<F>(token, 1, first),
            },
            light_normal: self.vector::<F>(token, 5, first),
            straight,
        };
        let probability = F::load(token, &self.numbers[2][first..]);
        let chains =
            CandidateChains { is_some: lanes, stack, chain, direction: self.vector::<F>(token, 6, first), probability };
        (
            Entry {
                ends,
                light: Rgb::new(light.x, light.y, light.z),
                pdf: F::load(token, &self.numbers[1][first..]),
                at,
            },
            chains,
        )
    }

    #[inline(always)]
    fn vector<F: Lanes>(&self, token: F::Token, k: usize, first: usize) -> V3<F> {
        let [x, y, z] = &self.vectors[k];
        V3::new(F::load(token, &x[first..]), F::load(token, &y[first..]), F::load(token, &z[first..]))
    }

    #[inline(always)]
    fn mask<F: Lanes>(&self, token: F::Token, k: usize, first: usize) -> F::Mask {
        F::load(token, &self.masks[k][first..]).is_positive()
    }

    /// Fills the columns, so that the last lanes can be loaded.
    pub(super) fn pad(&mut self, width: usize) {
        let len = self.paths.len();
        self.columns().for_each(|column| column.resize(len + width, 0.0));
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
