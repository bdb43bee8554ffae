//! Cost of random numbers: one set of the sampler, and the warps that follow it most often.

use criterion::{Criterion, criterion_group, criterion_main};
use dunkelfeld_sampling::{Distribution2D, Sampler, keyed_stream, warp};
use rand_core::Rng;
use std::hint::black_box;

fn sampler(c: &mut Criterion) {
    let mut group = c.benchmark_group("sampler");
    let mut i = 0u32;
    group.bench_function("new + get_4d", |b| {
        b.iter(|| {
            i = i.wrapping_add(1);
            Sampler::new(1, 0, i, 17).get_4d(3)
        });
    });
    let s = Sampler::new(1, 0, 123, 17);
    group.bench_function("get_4d", |b| {
        b.iter(|| {
            i = i.wrapping_add(1);
            s.get_4d(i)
        });
    });
    group.bench_function("get_2d", |b| {
        b.iter(|| {
            i = i.wrapping_add(1);
            s.get_2d(i)
        });
    });
    group.bench_function("get_1d", |b| {
        b.iter(|| {
            i = i.wrapping_add(1);
            s.get_1d(i)
        });
    });
    let mut stream = keyed_stream(1, 0, 0, 0);
    group.bench_function("keyed stream, next_u64", |b| b.iter(|| stream.next_u64()));
    group.finish();
}

fn warps(c: &mut Criterion) {
    let mut group = c.benchmark_group("warp");
    let s = Sampler::new(1, 0, 123, 17);
    let points: Vec<[f32; 2]> = (0..1024).map(|i| s.get_2d(i)).collect();
    let mut k = 0;
    let mut next = move || {
        k = (k + 1) % 1024;
        black_box(points[k])
    };
    group.bench_function("cosine hemisphere", |b| b.iter(|| warp::sample_cosine_hemisphere(next())));
    group.bench_function("polygon of 6 corners", |b| b.iter(|| warp::sample_polygon(next(), 6, 0.1)));
    let map = Distribution2D::new(2048, 1024, (0..2048 * 1024).map(|i| f64::from(i % 1009 * 7919 % 1009)));
    group.bench_function("map of 2048 x 1024", |b| b.iter(|| map.sample_continuous(next())));
    group.finish();
}

criterion_group!(benches, sampler, warps);
criterion_main!(benches);
