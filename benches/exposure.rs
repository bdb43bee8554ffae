//! Frames per second of the sensor at 5 megapixels, by signal level and number of threads.
//!
//! `cargo bench -p dunkelfeld --bench exposure`

use std::hint::black_box;
use std::ops::Range;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Seconds};
use dunkelfeld_sensor::{
    DarkCurrent, Defects, Device, Exposure, FixedPattern, FrameKey, Published, QuantumEfficiency, SensorModel,
    SensorSpec,
};

/// The format of an IMX250: 5.0 megapixels.
const WIDTH: u32 = 2448;
const HEIGHT: u32 = 2048;

fn spec() -> Option<SensorSpec> {
    Some(SensorSpec {
        name: "5 megapixels".into(),
        source: "bench".into(),
        derived: vec![],
        assumed: vec![],
        pixel_pitch: Metres::from_micrometres(3.45),
        resolution: None,
        quantum_efficiency: QuantumEfficiency::new(vec![(Nanometres(545.0), 0.7)]).ok()?.into(),
        full_well: Electrons(10_700.0),
        dark_noise: Electrons(2.4),
        row_noise: Electrons(0.0),
        dark_current: DarkCurrent { rate: 1.0, reference: Celsius(25.0), doubling: 7.0 },
        temperature: Celsius(25.0),
        system_gain: 0.38,
        offset: DigitalNumber(32.0),
        bit_depth: 12,
        fixed_pattern: FixedPattern { dsnu: Electrons(1.0), prnu: 0.005, ..FixedPattern::default() },
        defects: Defects::default(),
        min_exposure: None,
        max_exposure: None,
        published: Published::default(),
    })
}

/// The same with patterns of rows and columns, row noise, hot and dead pixels.
fn faulty(spec: SensorSpec) -> SensorSpec {
    let pattern = FixedPattern {
        dsnu_row: Electrons(0.3),
        dsnu_column: Electrons(0.5),
        prnu_row: 0.001,
        prnu_column: 0.002,
        ..spec.fixed_pattern.clone()
    };
    let defects = Defects { hot: 1e-4, hot_factor: 100.0, dead: 1e-5 };
    SensorSpec { fixed_pattern: pattern, defects, row_noise: Electrons(0.5), ..spec }
}

fn device(spec: SensorSpec) -> Option<Device> {
    Device::new(SensorModel::new(spec).ok()?, 1, WIDTH, HEIGHT).ok()
}

/// Exposes equal shares of the rows on threads of their own.
fn expose(device: &Device, electrons: &Plane<f32>, exposure: Exposure, frame: u32, out: &mut [u16], threads: u32) {
    let share = HEIGHT.div_ceil(threads);
    std::thread::scope(|scope| {
        for (i, part) in (0u32..).zip(out.chunks_mut((share * WIDTH) as usize)) {
            let rows: Range<u32> = i * share..((i + 1) * share).min(HEIGHT);
            scope.spawn(move || device.expose_rows(electrons, exposure, FrameKey { seed: 1, frame }, rows, part));
        }
    });
}

fn frames(c: &mut Criterion) {
    let devices = (spec().and_then(device), spec().map(faulty).and_then(device));
    let ((Some(device), Some(faulty)), Ok(exposure)) = (devices, Exposure::new(Seconds(5e-3))) else { return };
    let mut group = c.benchmark_group("expose 5 megapixels");
    group.throughput(Throughput::Elements(u64::from(WIDTH) * u64::from(HEIGHT)));
    group.sample_size(10).measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));
    let dark_field = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        // A dark ground of a few electrons, a bright ring, some highlights: the mix that branches worst.
        let r = f32::hypot(x as f32 - 1224.0, y as f32 - 1024.0);
        if (400.0..600.0).contains(&r) { r * 12.0 } else { (x % 16) as f32 }
    });
    let scenes = [
        ("dark, 3 e-", Plane::new(WIDTH, HEIGHT, 3.0)),
        ("dim, 30 e-", Plane::new(WIDTH, HEIGHT, 30.0)),
        ("bright, 5000 e-", Plane::new(WIDTH, HEIGHT, 5000.0)),
        ("dark field, every fault", dark_field.clone()),
        ("dark field", dark_field),
    ];
    let mut out = vec![0u16; (WIDTH * HEIGHT) as usize];
    for (name, electrons) in &scenes {
        let device = if name.contains("fault") { &faulty } else { &device };
        for threads in [1, 2] {
            let id = BenchmarkId::new(*name, format!("{threads} threads"));
            group.bench_with_input(id, &threads, |b, &threads| {
                let mut frame = 0;
                b.iter(|| {
                    frame += 1;
                    expose(device, electrons, exposure, frame, &mut out, threads);
                    black_box(out[0])
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
