//! EXR files: round trips, reproducible bytes, foreign layer names, windows, damaged files; factors of Radiance files.

use std::path::Path;

use dunkelfeld_film::Plane;
use dunkelfeld_io::exr::{Channel, ChannelKind, ExrFrame, ExrHead, ExrLayers, read_exr, write_exr, write_exr_rows};
use dunkelfeld_io::images::decode_image;
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_io::loader::Limits;
use dunkelfeld_scene::Texels;
use exr::meta::attribute::{Chromaticities, IntegerBounds};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, SmallVec, Text, Vec2, WritableImage, f16,
};
use std::ops::Range;

const W: u32 = 37;
const H: u32 = 21;

fn triples(offset: f32) -> Plane<[f32; 3]> {
    Plane::from_fn(W, H, |x, y| [x as f32 + offset, y as f32 * 1e-7, f32::INFINITY])
}

fn example() -> ExrLayers {
    let mut layers = ExrLayers::new(W, H);
    layers.push_triples(Triple::Mean, &triples(0.1));
    layers.push_triples(Triple::Variance, &triples(0.2));
    layers.push_triples(Triple::Albedo, &triples(0.3));
    layers.push_triples(Triple::Normal, &triples(0.4));
    layers.push_integers(Single::SampleCount, Plane::from_fn(W, H, |x, y| x * y + (1 << 30) + 1));
    layers.push_integers(Single::ObjectId, Plane::from_fn(W, H, |x, _| u32::MAX - x));
    layers.push_floats(Single::Depth, Plane::from_fn(W, H, |x, y| (x + y) as f32));
    layers.push_floats(Single::Electrons, Plane::new(W, H, 7.5));
    layers.attributes = r#"{"scene":"Prüfling \"☂\" 🎥","spp":64}"#.into();
    layers
}

fn temporary() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

#[test]
fn every_layer_is_read_bit_for_bit() {
    let folder = temporary();
    let path = folder.path().join("render.exr");
    write_exr(&path, example()).expect("written");
    let read = read_exr(&path).expect("readable");
    assert_eq!((read.width, read.height, read.channels.len()), (W, H, 16));
    for (layer, offset) in [(Triple::Mean, 0.1), (Triple::Variance, 0.2), (Triple::Albedo, 0.3), (Triple::Normal, 0.4)]
    {
        assert_eq!(read.triples(layer), Some(triples(offset)), "{layer:?}");
    }
    assert_eq!(read.integers(Single::SampleCount), Some(Plane::from_fn(W, H, |x, y| x * y + (1 << 30) + 1)));
    assert_eq!(read.integers(Single::ObjectId), Some(Plane::from_fn(W, H, |x, _| u32::MAX - x)));
    assert_eq!(read.single(Single::Depth), Some(Plane::from_fn(W, H, |x, y| (x + y) as f32)));
    assert_eq!(read.single(Single::Electrons), Some(Plane::new(W, H, 7.5)));
    assert_eq!(read.triples(Triple::Denoised), None);
    assert_eq!(read.single(Single::Hidden), None);
    let names: Vec<&str> = read.channels.iter().map(|(n, _)| n.as_str()).collect();
    for name in ["R", "G", "B", "variance.R", "spp.Y", "albedo.G", "normal.Z", "depth.Z", "id.object", "electrons.Y"] {
        assert!(names.contains(&name), "{name} is not among {names:?}");
    }
    // Escaped, but the same JSON.
    let json: serde_json::Value = serde_json::from_str(&read.attributes).expect("JSON");
    assert_eq!(json["scene"], "Prüfling \"☂\" 🎥");
    assert_eq!(json["spp"], 64);
}

#[test]
fn not_a_number_keeps_its_bits() {
    let folder = temporary();
    let path = folder.path().join("nan.exr");
    let bits = [0x7fc0_1234u32, 0xff80_0000, 0x0000_0001, 0x8000_0000];
    let mut layers = ExrLayers::new(2, 2);
    layers.channels.push(("Y".into(), Channel::F32(bits.map(f32::from_bits).to_vec())));
    write_exr(&path, layers).expect("written");
    match read_exr(&path).expect("readable").channel("Y") {
        Some(Channel::F32(v)) => assert_eq!(v.iter().map(|f| f.to_bits()).collect::<Vec<_>>(), bits),
        other => panic!("{other:?}"),
    }
}

#[test]
fn two_writes_are_identical_whatever_the_order_of_the_channels() {
    let folder = temporary();
    // Large enough for many blocks, so that the encoder's threads could finish in another order.
    let big = || {
        let mut layers = ExrLayers::new(301, 700);
        layers.push_triples(Triple::Mean, &Plane::from_fn(301, 700, |x, y| [(x ^ y) as f32, (x * y) as f32, 0.5]));
        layers.push_floats(Single::Depth, Plane::from_fn(301, 700, |x, y| (x as f32).sin() + y as f32));
        layers.attributes = "{\"a\":1}".into();
        layers
    };
    let mut turned = big();
    turned.channels.reverse();
    let files = ["a.exr", "b.exr", "c.exr"].map(|name| folder.path().join(name));
    for (path, layers) in files.iter().zip([big(), big(), turned]) {
        write_exr(path, layers).expect("written");
    }
    let [a, b, c] = files.map(|path| std::fs::read(path).expect("readable"));
    assert!(a == b && a == c, "the bytes differ");
}

/// An image of both types of samples, of those rows.
fn rows_of(width: u32, rows: Range<u32>) -> ExrLayers {
    let height = rows.end - rows.start;
    let mut strip = ExrLayers::new(width, height);
    let value = |x: u32, y: u32| ((x * 7919 + (y + rows.start) * 104_729) % 65_521) as f32 * 0.37;
    // Not in the order of their names.
    strip.push_integers(Single::SampleCount, Plane::from_fn(width, height, |x, y| x ^ ((y + rows.start) << 20)));
    strip.push_triples(Triple::Mean, &Plane::from_fn(width, height, |x, y| [value(x, y), -value(x, y), f32::INFINITY]));
    strip.push_floats(Single::Depth, Plane::from_fn(width, height, |x, y| value(y, x)));
    strip.attributes = r#"{"scene":"Prüfling"}"#.into();
    strip
}

/// The same image as the library's own writer encodes it.
fn encoded_whole(layers: ExrLayers) -> Vec<u8> {
    let list: SmallVec<[_; 4]> = layers
        .channels
        .into_iter()
        .map(|(name, samples)| {
            let samples = match samples {
                Channel::F32(v) => FlatSamples::F32(v),
                Channel::U32(v) => FlatSamples::U32(v),
            };
            AnyChannel::new(name.as_str(), samples)
        })
        .collect();
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let size = (layers.width as usize, layers.height as usize);
    let layer = Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(list));
    let mut image = Image::from_layer(layer);
    let escaped = layers.attributes.replace('ü', "\\u00fc");
    let value = exr::meta::attribute::AttributeValue::Text(Text::from(escaped.as_str()));
    image.attributes.other.insert(Text::from("dunkelfeld"), value);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).expect("a valid image");
    bytes.into_inner()
}

#[test]
fn strips_make_the_same_bytes_as_the_whole() {
    let folder = temporary();
    for (width, height) in [(1, 1), (17, 33), (100, 64)] {
        let whole = folder.path().join("whole.exr");
        write_exr(&whole, rows_of(width, 0..height)).expect("written");
        let head = ExrHead::from_strip(&rows_of(width, 0..0), height);
        assert_eq!(head.channels.len(), 5);
        assert_eq!(head.channels[0], ("spp.Y".into(), ChannelKind::U32));
        let path = folder.path().join("strips.exr");
        write_exr_rows(&path, &head, &mut |rows| Ok(rows_of(width, rows).into_samples())).expect("written");
        let bytes = std::fs::read(&path).expect("readable");
        assert!(bytes == std::fs::read(&whole).expect("readable"), "{width} x {height}: strips differ from the whole");
        // The library compresses with another level. It reads the same image from both.
        let read = |bytes: Vec<u8>| {
            let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
            reader.first_valid_layer().all_attributes().from_buffered(std::io::Cursor::new(bytes)).expect("an image")
        };
        let library = encoded_whole(rows_of(width, 0..height));
        assert!(read(bytes) == read(library), "{width} x {height}: differs from the library's");
    }
}

#[test]
fn a_strip_is_small_whatever_the_image() {
    let channels: Vec<_> = (0..36).map(|i| (format!("c{i}"), ChannelKind::F32)).collect();
    for (width, height) in [(1, 1), (512, 512), (4096, 4096), (16_384, 32_768), (65_536, 65_536)] {
        let head = ExrHead { width, height, channels: channels.clone(), attributes: String::new(), frame: None };
        let rows = head.strip_rows();
        let bytes = u64::from(width) * u64::from(rows) * 36 * 4;
        assert!(rows == height || rows.is_multiple_of(16), "{rows} rows");
        assert!(bytes <= 32 << 20 || rows == 16, "{bytes} bytes for {width} x {height}");
        // And not needlessly many of them.
        assert!(rows == height || bytes + u64::from(width) * 16 * 36 * 4 > 32 << 20, "{bytes} bytes");
    }
}

#[test]
fn a_strip_that_does_not_fit_leaves_the_target_as_it_was() {
    let folder = temporary();
    let path = folder.path().join("kept.exr");
    std::fs::write(&path, b"precious").expect("written");
    let (width, height) = (17, 33);
    let head = ExrHead::from_strip(&rows_of(width, 0..0), height);
    type Spoil = fn(&mut Vec<Channel>);
    let spoils: [(Spoil, &str); 3] = [
        (|strip| strip.truncate(4), "4 channels"),
        (|strip| strip.swap(0, 1), "type"),
        (|strip| strip[1] = Channel::F32(vec![0.0; 3]), "3 samples"),
    ];
    for (spoil, word) in spoils {
        let error = write_exr_rows(&path, &head, &mut |rows| {
            let mut strip = rows_of(width, rows).into_samples();
            spoil(&mut strip);
            Ok(strip)
        })
        .expect_err("must be refused");
        assert!(error.to_string().contains(word), "{error}");
        assert_eq!(std::fs::read(&path).expect("readable"), b"precious");
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "no temporary file stays");
}

/// A data window smaller than the display window, larger, beside it, and apart from it.
#[test]
fn the_picture_is_the_display_window() {
    let folder = temporary();
    let path = folder.path().join("windows.exr");
    let (red, green, blue) = (Vec2(0.713, 0.293), Vec2(0.165, 0.83), Vec2(0.128, 0.044));
    let chromaticities = Some(Chromaticities { red, green, blue, white: Vec2(0.3217, 0.3377) });
    for (position, display) in [
        (Vec2(10, -5), IntegerBounds::new((0, 0), (64, 40))),
        (Vec2(-10, 5), IntegerBounds::new((-4, 9), (8, 3))),
        (Vec2(3, 4), IntegerBounds::new((20, -2), (30, 12))),
        (Vec2(3, 4), IntegerBounds::new((3, 4), (W as usize, H as usize))),
        (Vec2(-100, 100), IntegerBounds::new((0, 0), (9, 7))),
    ] {
        let frame = Some(ExrFrame { position, display, chromaticities });
        let value = |x: u32, y: u32| (1 + x + W * y) as f32;
        let mut layers = ExrLayers { frame, ..ExrLayers::new(W, H) };
        layers.push_floats(Single::Depth, Plane::from_fn(W, H, value));
        write_exr(&path, layers.clone()).expect("written");
        let read = read_exr(&path).expect("readable");
        assert_eq!(read, layers, "the windows are kept");
        assert!(read.check_primaries(&path).expect_err("ACEScg").help.contains("Rec. 709"));
        let expected = Plane::from_fn(display.size.0 as u32, display.size.1 as u32, |x, y| {
            let at = Vec2(x as i32, y as i32) + display.position - position;
            let inside = (0..W as i32).contains(&at.0) && (0..H as i32).contains(&at.1);
            if inside { value(at.0 as u32, at.1 as u32) } else { 0.0 }
        });
        assert_eq!(read.displayed().single(Single::Depth), Some(expected), "{position:?} in {display:?}");
    }
}

#[test]
fn an_error_leaves_the_target_as_it_was() {
    let folder = temporary();
    let path = folder.path().join("kept.exr");
    std::fs::write(&path, b"precious").expect("written");
    let with = |name: &str, samples: Vec<f32>| ExrLayers {
        channels: vec![(name.into(), Channel::F32(samples))],
        ..ExrLayers::new(2, 2)
    };
    let mut twice = with("R", vec![0.0; 4]);
    twice.channels.push(("R".into(), Channel::F32(vec![0.0; 4])));
    let bad = [
        ExrLayers::new(2, 2),
        ExrLayers { channels: vec![("R".into(), Channel::F32(vec![]))], ..ExrLayers::new(0, 2) },
        with("R", vec![0.0; 3]),
        with("", vec![0.0; 4]),
        with("Größe", vec![0.0; 4]),
        with(&"x".repeat(256), vec![0.0; 4]),
        twice,
    ];
    for layers in bad {
        let error = write_exr(&path, layers.clone()).expect_err("must be refused");
        assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput, "{error}: {layers:?}");
    }
    assert_eq!(std::fs::read(&path).expect("readable"), b"precious");
}

/// A file as other programs write it: parts with names, half precision, any channel names.
fn foreign(path: &Path, parts: &[(&str, (usize, usize), &[&str])]) {
    let layers: SmallVec<[_; 2]> = parts
        .iter()
        .map(|(part, size, names)| {
            let list: SmallVec<[_; 4]> = names
                .iter()
                .enumerate()
                .map(|(i, name)| {
                    let value = f16::from_f32(i as f32 + 0.5);
                    AnyChannel::new(*name, FlatSamples::F16(vec![value; size.0 * size.1]))
                })
                .collect();
            let attributes = match *part {
                "" => LayerAttributes::default(),
                name => LayerAttributes::named(Text::from(name)),
            };
            Layer::new(*size, attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(list))
        })
        .collect();
    let bounds = IntegerBounds::from_dimensions(parts[0].1);
    let image = Image::from_layers(exr::meta::header::ImageAttributes::new(bounds), layers);
    image.write().to_file(path).expect("a valid image");
}

#[test]
fn layers_of_other_programs_are_found() {
    let folder = temporary();
    let path = folder.path().join("foreign.exr");
    let first = |layers: &ExrLayers, which| layers.triples(which).map(|p| p.data()[0]);
    let rgb = Some([0.5, 1.5, 2.5]);

    // Blender, one part with long names.
    let names = [
        "ViewLayer.Combined.R",
        "ViewLayer.Combined.G",
        "ViewLayer.Combined.B",
        "ViewLayer.Combined.A",
        "ViewLayer.Denoising Normal.X",
        "ViewLayer.Denoising Normal.Y",
        "ViewLayer.Denoising Normal.Z",
        "ViewLayer.Denoising Albedo.R",
        "ViewLayer.Denoising Albedo.G",
        "ViewLayer.Denoising Albedo.B",
        "ViewLayer.Depth.Z",
    ];
    foreign(&path, &[("", (4, 3), &names)]);
    let blender = read_exr(&path).expect("readable");
    assert_eq!(first(&blender, Triple::Mean), rgb);
    assert_eq!(first(&blender, Triple::Normal), Some([4.5, 5.5, 6.5]));
    assert_eq!(first(&blender, Triple::Albedo), Some([7.5, 8.5, 9.5]));
    assert_eq!(blender.single(Single::Depth).map(|p| p.data()[0]), Some(10.5));

    // Blender, one part for each pass, denoised by Cycles: the image as it was rendered counts.
    let rgba: &[&str] = &["R", "G", "B", "A"];
    let named = |pass: &'static str, names| (pass, (4, 3), names);
    let parts: [(&str, (usize, usize), &[&str]); 5] = [
        named("ViewLayer.Combined", rgba),
        named("ViewLayer.Noisy Image", &["Noisy Image.A", "Noisy Image.R", "Noisy Image.G", "Noisy Image.B"]),
        named("ViewLayer.Denoising Albedo", &["R", "G", "B"]),
        named("ViewLayer.Normal", &["X", "Y", "Z", "W", "V", "U"]),
        named("ViewLayer.Denoising Normal", &["X", "Y", "Z"]),
    ];
    foreign(&path, &parts);
    let cycles = read_exr(&path).expect("readable");
    assert_eq!(first(&cycles, Triple::Mean), Some([1.5, 2.5, 3.5]));
    assert_eq!(first(&cycles, Triple::Albedo), rgb);
    assert_eq!(first(&cycles, Triple::Normal), rgb);

    // Mitsuba names the depth after the AOV and its type.
    foreign(&path, &[("", (4, 3), &["R", "G", "B", "dd.y.T", "sh_normal.X", "sh_normal.Y", "sh_normal.Z"])]);
    let mitsuba = read_exr(&path).expect("readable");
    assert_eq!(mitsuba.single(Single::Depth).map(|p| p.data()[0]), Some(3.5));
    assert_eq!(first(&mitsuba, Triple::Normal), Some([4.5, 5.5, 6.5]));

    // Mitsuba, plain RGB and AOVs.
    foreign(
        &path,
        &[("", (4, 3), &["R", "G", "B", "albedo.R", "albedo.G", "albedo.B", "nn.X", "nn.Y", "nn.Z", "dd.T"])],
    );
    let mitsuba = read_exr(&path).expect("readable");
    assert_eq!(first(&mitsuba, Triple::Mean), rgb);
    assert_eq!(first(&mitsuba, Triple::Albedo), Some([3.5, 4.5, 5.5]));
    assert_eq!(first(&mitsuba, Triple::Normal), Some([6.5, 7.5, 8.5]));
    assert_eq!(mitsuba.single(Single::Depth).map(|p| p.data()[0]), Some(9.5));

    // Positions, or CIE's colours: no light in red, green and blue, and Y alone is not their brightness.
    foreign(&path, &[("", (4, 3), &["X", "Y", "Z"])]);
    let vectors = read_exr(&path).expect("readable");
    assert_eq!((first(&vectors, Triple::Mean), vectors.triples_named("").is_some()), (None, false));
    foreign(&path, &[("", (4, 3), &["Y"])]);
    assert_eq!(first(&read_exr(&path).expect("readable"), Triple::Mean), Some([0.5; 3]));

    // Parts with names, one of another size.
    let parts: [(&str, (usize, usize), &[&str]); 3] =
        [("beauty", (4, 3), &["R", "G", "B"]), ("albedo", (4, 3), &["R", "G", "B"]), ("thumb", (2, 2), &["R"])];
    foreign(&path, &parts);
    let parts = read_exr(&path).expect("readable");
    assert_eq!(first(&parts, Triple::Mean), rgb);
    assert_eq!(first(&parts, Triple::Albedo), rgb);
    assert_eq!(parts.channels.len(), 6);

    // Grey.
    foreign(&path, &[("", (4, 3), &["Y"])]);
    assert_eq!(first(&read_exr(&path).expect("readable"), Triple::Mean), Some([0.5; 3]));
    assert_eq!(first(&read_exr(&path).expect("readable"), Triple::Normal), None);
}

#[test]
fn files_that_are_no_exr_are_refused_by_name() {
    let folder = temporary();
    let path = folder.path().join("no.exr");
    for bytes in [&b""[..], b"not an image", &[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0]] {
        std::fs::write(&path, bytes).expect("written");
        let message = read_exr(&path).expect_err("no EXR").to_string();
        assert!(message.contains("no.exr"), "{message}");
    }
    assert!(read_exr(&folder.path().join("absent.exr")).is_err());
    assert!(read_exr(folder.path()).is_err());
}

/// Any byte may be wrong and any tail may be missing: reading ends in an image or an error, never in a panic.
#[test]
fn damaged_files_do_not_panic() {
    let folder = temporary();
    let path = folder.path().join("damaged.exr");
    let mut small = ExrLayers::new(5, 4);
    small.push_triples(Triple::Mean, &Plane::from_fn(5, 4, |x, y| [x as f32, y as f32, 1.0]));
    small.attributes = "{}".into();
    write_exr(&path, small).expect("written");
    let whole = std::fs::read(&path).expect("readable");
    for i in 0..whole.len() {
        for flip in [0xff, 0x01] {
            let mut bytes = whole.clone();
            bytes[i] ^= flip;
            std::fs::write(&path, &bytes).expect("written");
            let _ = read_exr(&path);
        }
        std::fs::write(&path, &whole[..i]).expect("written");
        assert!(read_exr(&path).is_err(), "cut after {i} of {} bytes", whole.len());
    }
}

/// One part with the channel `Y`, 16 x 16 samples of half precision in one chunk. Gives the file and where the chunk's data
/// begin, which go on to the end of the file behind their length.
fn one_chunk(path: &Path, compression: Compression) -> (Vec<u8>, usize) {
    let samples = (0..16 * 16).map(|i| f16::from_f32(1.0 + (i % 16) as f32)).collect();
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![AnyChannel::new("Y", FlatSamples::F16(samples))]));
    let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((16, 16), LayerAttributes::default(), encoding, channels);
    Image::from_layer(layer).write().to_file(path).expect("written");
    read_exr(path).unwrap_or_else(|e| panic!("{compression:?}: {e}"));
    let file = std::fs::read(path).expect("there");
    let ends = |start: &usize| file[start - 4..*start] == ((file.len() - start) as u32).to_le_bytes();
    let start = (4..file.len()).rev().find(ends).expect("a chunk at the end");
    (file, start)
}

/// Found by fuzzing: the decoder of B44 leaves the range of its numbers, which panics where overflow is checked, and on the
/// threads of the library such a panic ended the process.
#[test]
fn blocks_that_make_the_decoder_panic_are_refused_or_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("b44.exr");
    let (file, start) = one_chunk(&path, Compression::B44);
    for (byte, kept) in (0..=255).map(|byte| (Some(byte), file.len())).chain((start..file.len()).map(|n| (None, n))) {
        let mut changed = file[..kept].to_vec();
        changed[start - 4..start].copy_from_slice(&((kept - start) as u32).to_le_bytes());
        if let Some(byte) = byte {
            changed[start..].fill(byte);
        }
        std::fs::write(&path, &changed).expect("written");
        match read_exr(&path) {
            Ok(layers) => assert_eq!(layers.channels[0].1.len(), 16 * 16),
            Err(error) => assert!(error.to_string().contains("b44.exr"), "{byte:?}, {kept}: {error}"),
        }
    }
}

/// Found by fuzzing: a block of DWA states the sizes of its sections, and the decoder allocated that much memory at once.
#[test]
fn blocks_that_promise_more_than_the_image_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("dwa.exr");
    for compression in [Compression::DWAA(None), Compression::DWAB(None)] {
        let (file, start) = one_chunk(&path, compression);
        for field in 1..10 {
            for size in [1 << 20, 1 << 53, u64::MAX / 2, u64::MAX] {
                let mut changed = file.clone();
                changed[start + 8 * field..][..8].copy_from_slice(&size.to_le_bytes());
                std::fs::write(&path, &changed).expect("written");
                let error = read_exr(&path).expect_err("a size beyond the image").to_string();
                assert!(error.contains("dwa.exr"), "{field}, {size}: {error}");
                let limits = Limits::default();
                assert!(decode_image(&changed, "dwa.exr", &limits).is_err(), "{field}, {size}");
            }
        }
    }
}

/// Found by fuzzing: the bytes that a header states for many channels of the largest size left the range of 64 bits.
#[test]
fn images_of_the_largest_size_with_many_channels_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("vast.exr");
    for channels in [1, 4, 8, 60] {
        let channel = |i| AnyChannel::new(format!("c{i}").as_str(), FlatSamples::F32(vec![0.0; 4]));
        let channels = AnyChannels::sort((0..channels).map(channel).collect());
        let layer = Layer::new((2, 2), LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
        Image::from_layer(layer).write().to_file(&path).expect("written");
        let mut file = std::fs::read(&path).expect("there");
        let name = b"dataWindow\0box2i\0";
        let at = file.windows(name.len()).position(|w| w == name).expect("a window") + name.len() + 4;
        for corner in [8, 12] {
            file[at + corner..][..4].copy_from_slice(&(i32::MAX / 2 - 2).to_le_bytes());
        }
        std::fs::write(&path, &file).expect("written");
        let error = read_exr(&path).expect_err("too large").to_string();
        assert!(error.contains("vast.exr") && error.contains("states"), "{error}");
    }
}

/// Found by fuzzing: tiles far larger than the image, for which the decoder took memory as they stand.
#[test]
fn tiles_that_are_far_larger_than_the_image_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("tiles.exr");
    let samples = FlatSamples::F32((0..16 * 16).map(|i| i as f32).collect());
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![AnyChannel::new("Y", samples)]));
    let compression = Compression::ZIP16;
    // An image of one tile, which the header then calls larger.
    for (tile, is_read) in [(16, true), (1 << 18, true), (1 << 20, false), (1 << 29, false)] {
        let encoding = Encoding { compression, blocks: Blocks::Tiles(Vec2(16, 16)), line_order: LineOrder::Increasing };
        let layer = Layer::new((16, 16), LayerAttributes::default(), encoding, channels.clone());
        Image::from_layer(layer).write().to_file(&path).expect("written");
        let mut file = std::fs::read(&path).expect("there");
        let name = b"tiledesc\0";
        let at = file.windows(name.len()).position(|w| w == name).expect("tiles") + name.len() + 4;
        let size = (tile as u32).to_le_bytes();
        file[at + 4..][..4].copy_from_slice(&size);
        std::fs::write(&path, &file).expect("written");
        let read = read_exr(&path);
        if is_read {
            assert_eq!(read.expect("tiles of up to 16 MiB are read").channels[0].1.len(), 16 * 16, "{tile}");
        } else {
            let error = read.expect_err("a tile beyond the image").to_string();
            assert!(error.contains("tiles of") && error.contains("tiles.exr"), "{tile}: {error}");
        }
    }
}

#[test]
fn images_of_many_blocks_come_back_in_their_order() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("tall.exr");
    let mut layers = ExrLayers::new(3, 5000);
    layers.push_integers(Single::SampleCount, Plane::from_fn(3, 5000, |x, y| 3 * y + x));
    write_exr(&path, layers.clone()).expect("written");
    assert_eq!(read_exr(&path).expect("readable"), layers);
}

fn texels(bytes: &[u8]) -> Texels {
    (*decode_image(bytes, "a", &Limits::default()).expect("decodes").image.texels).clone()
}

#[test]
fn the_factors_of_a_radiance_file_are_divided_out() {
    let file =
        |head: &str| [format!("{head}FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n").as_bytes(), &[128, 64, 32, 129]].concat();
    let bytes = file("#?RGBE\nEXPOSURE=0.25\nEXPOSURE= 2\nCOLORCORR=1 0.5 4\n");
    assert_eq!(texels(&bytes), Texels::RgbF32(vec![[2.0, 2.0, 0.125]]));
    assert_eq!(texels(&file("#?RADIANCE\n")), Texels::RgbF32(vec![[1.0, 0.5, 0.25]]));
    let fault = decode_image(&file("#?RADIANCE\nEXPOSURE=0\n"), "a", &Limits::default()).expect_err("no factor");
    assert!(fault.problem.contains("EXPOSURE"), "{fault:?}");
}

#[test]
fn an_exr_is_cut_to_its_display_window_and_has_the_primaries_of_rec_709() {
    let file = |white: f32| {
        let list = vec![AnyChannel::new("Y", FlatSamples::F32(vec![1.0, 2.0, 3.0, 4.0]))];
        let mut image = Image::from_channels((2, 2), AnyChannels::sort(list.into()));
        image.attributes.display_window = IntegerBounds::new(Vec2(1, 0), Vec2(3, 1));
        let (red, green, blue) = (Vec2(0.64, 0.33), Vec2(0.3, 0.6), Vec2(0.15, 0.06));
        image.attributes.chromaticities = Some(Chromaticities { red, green, blue, white: Vec2(white, 0.329) });
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).expect("encode");
        bytes.into_inner()
    };
    let decoded = decode_image(&file(0.3127), "a", &Limits::default()).expect("decodes").image;
    assert_eq!((decoded.width, decoded.height), (3, 1));
    assert_eq!(*decoded.texels, Texels::GrayF32(vec![[2.0], [0.0], [0.0]]));
    let fault = decode_image(&file(0.3457), "a", &Limits::default()).expect_err("another white");
    assert!(fault.problem.contains("Rec. 709") && fault.help.contains("convert"), "{fault:?}");
}
