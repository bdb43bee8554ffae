//! Candidate chains of several receivers at once have the bits of single ones, through stacks of several kinds.

use dunkelfeld_geometry::{DVec3, Mesh, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::covers::Wanted;
use dunkelfeld_scene::shapes::{cuboid, rectangle};
use dunkelfeld_scene::{CandidateChains, Chain, Material, Scene, SceneBuilder, Surface, Targets, Volume};

fn clear(ior: f32) -> Material {
    let surface = Surface::Solid(Volume::default());
    Material { transmission: 1.0, roughness: 0.0, ior, surface, ..Material::default() }
}

fn milky(ior: f32) -> Material {
    let volume = Volume { scattering: dunkelfeld_radiometry::Rgb::splat(100.0), ..Volume::default() };
    Material { surface: Surface::Solid(volume), ..clear(ior) }
}

/// A plate of 80 mm x 60 mm between two heights \[m\].
fn plate(low: f32, high: f32) -> Mesh {
    cuboid(Vec3::new(-0.04, -0.03, low), Vec3::new(0.04, 0.03, high))
}

fn scene(objects: Vec<(Mesh, Material)>) -> Scene {
    let mut b = SceneBuilder::default();
    for (k, (mesh, material)) in objects.into_iter().enumerate() {
        let m = b.add_material(material);
        b.add_object(&format!("object {k}"), mesh, m);
    }
    let m = b.add_material(Material::default());
    b.add_object("floor", rectangle(Vec3::new(-0.2, -0.2, -0.3), Vec3::X * 0.4, Vec3::Y * 0.4), m);
    b.build().expect("the scene is valid").0
}

struct Inputs {
    active: u32,
    finite: u32,
    from: [Vec3; MAX_WIDTH],
    point: [Vec3; MAX_WIDTH],
    direction: [Vec3; MAX_WIDTH],
    inside: [Option<u32>; MAX_WIDTH],
    u: [f32; MAX_WIDTH],
}

type Found = Option<(u16, Chain, [u32; 4])>;

/// The chosen candidate of each lane, and the same one if it is given.
#[inline(always)]
fn choose<F: Lanes>(token: F::Token, scene: &Scene, inputs: &Inputs, out: &mut [[Found; 2]; MAX_WIDTH]) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let lanes = |all: &[Vec3; MAX_WIDTH]| std::array::from_fn(|lane| all[(at + lane) % MAX_WIDTH]);
        let inside = std::array::from_fn(|lane| inputs.inside[(at + lane) % MAX_WIDTH]);
        let from = V3::from_lanes(token, &lanes(&inputs.from));
        let targets = Targets {
            point: V3::from_lanes(token, &lanes(&inputs.point)),
            direction: V3::from_lanes(token, &lanes(&inputs.direction)),
            is_finite: F::mask(token, inputs.finite >> at),
        };
        let active = F::mask(token, inputs.active >> at);
        let random = Wanted::Random(F::load(token, &inputs.u[at..]));
        let chosen = scene.choose_chains(random, active, from, &inside, &targets);
        let given = Wanted::Given(chosen.chain);
        let given = scene.choose_chains(given, chosen.is_some, from, &inside, &targets);
        record(&chosen, at, 0, out);
        record(&given, at, 1, out);
    }
}

fn record<F: Lanes>(found: &CandidateChains<F>, at: usize, which: usize, out: &mut [[Found; 2]; MAX_WIDTH]) {
    let (directions, probabilities) = (found.direction.to_lanes(), found.probability.to_array());
    for lane in 0..F::WIDTH {
        let [x, y, z] = directions[lane].to_array();
        let numbers = [x, y, z, probabilities[lane]].map(f32::to_bits);
        let is_some = found.is_some.bits() >> lane & 1 == 1;
        out[at + lane][which] = is_some.then_some((found.chain[lane].0, found.chain[lane].1, numbers));
    }
}

fn inputs(scene: &Scene, round: u64) -> Inputs {
    let mut inputs = Inputs {
        active: Sampler::new(round, 0, 99, 0).get_4d(0)[0].to_bits() | 0x21,
        finite: 0,
        from: [Vec3::ZERO; MAX_WIDTH],
        point: [Vec3::ZERO; MAX_WIDTH],
        direction: [Vec3::ZERO; MAX_WIDTH],
        inside: [None; MAX_WIDTH],
        u: [0.0; MAX_WIDTH],
    };
    for lane in 0..MAX_WIDTH {
        let sampler = Sampler::new(round, 0, lane as u32, 0);
        let number = |d| sampler.get_4d(d).map(f64::from);
        let ([a, b, c, d], [e, f, g, h], [i, j, k, l]) = (number(0), number(1), number(2));
        // Some receivers lie in contact with the cover, some between sheets, and some in solids.
        let height = [-0.003, 0.001, 0.0055, 0.003 * d - 0.002, 0.02 * d - 0.01][(5.0 * c) as usize];
        let x = DVec3::new(0.12 * (a - 0.5), 0.09 * (b - 0.5), height);
        let y = DVec3::new(0.4 * (e - 0.5), 0.4 * (f - 0.5), 0.4 * (g - 0.25));
        let [x, y] = if h < 0.2 { [y, x] } else { [x, y] }.map(|p| (p - scene.world_origin()).as_vec3());
        (inputs.from[lane], inputs.point[lane]) = (x, y);
        let straight = if i < 0.1 { Vec3::ZERO } else { Vec3::new(a as f32 - 0.5, e as f32 - 0.5, 0.0) };
        inputs.direction[lane] = (straight + Vec3::Z * (f as f32 - 0.2)).normalize_or(Vec3::Z);
        inputs.finite |= u32::from(j < 0.8) << lane;
        inputs.inside[lane] = [None, None, Some(0), Some(1)][(4.0 * k) as usize];
        inputs.u[lane] = l as f32;
    }
    inputs
}

fn check(name: &str, objects: Vec<(Mesh, Material)>) {
    let scene = scene(objects);
    let mut candidates = 0;
    let mut longer = 0;
    for round in 0..2000 {
        let inputs = inputs(&scene, round);
        let mut expected = [[None; 2]; MAX_WIDTH];
        choose::<f32>((), &scene, &inputs, &mut expected);
        for [chosen, given] in expected {
            assert_eq!(chosen, given, "{name}, round {round}: the choice is the candidate that is given");
            candidates += usize::from(chosen.is_some());
            longer += usize::from(chosen.is_some_and(|(_, chain, _)| chain.order() > 0));
        }
        for set in InstructionSet::all() {
            let mut found = [[None; 2]; MAX_WIDTH];
            dispatch!(set, F, token => choose::<F>(token, &scene, &inputs, &mut found));
            assert_eq!(found, expected, "{name}, {set:?}, round {round}");
        }
    }
    assert!(candidates > 1000 && longer > 10, "{name}: {candidates} candidates, {longer} longer ones");
}

#[test]
fn one_sheet() {
    check("a sheet", vec![(plate(0.001, 0.005), clear(1.49))]);
    check("a bubble", vec![(plate(0.001, 0.005), clear(0.8))]);
}

#[test]
fn sheets_above_each_other() {
    check("a gap", vec![(plate(0.001, 0.005), clear(1.49)), (plate(0.006, 0.0065), clear(1.58))]);
    check("glued", vec![(plate(0.001, 0.005), clear(1.49)), (plate(0.005, 0.0065), clear(1.58))]);
    let third = (plate(0.008, 0.01), clear(1.7));
    check("three", vec![(plate(0.001, 0.005), clear(1.49)), (plate(0.006, 0.0065), clear(1.58)), third]);
}

#[test]
fn receivers_in_a_scattering_solid() {
    check("the same index", vec![(plate(0.001, 0.005), clear(1.49)), (plate(-0.02, 0.001), milky(1.49))]);
    check("another index", vec![(plate(0.001, 0.005), clear(1.49)), (plate(-0.02, 0.001), milky(1.6))]);
}

#[test]
fn several_stacks() {
    let beside = |x: f32, z: f32| cuboid(Vec3::new(x - 0.03, -0.03, z), Vec3::new(x + 0.03, 0.03, z + 0.002));
    check("two stacks", vec![(beside(-0.035, 0.001), clear(1.49)), (beside(0.035, 0.005), clear(1.6))]);
}
