//! PNG and TIFF files, read back by a decoder that is not the one behind the encoder's module.

use std::path::Path;

use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::write_png;
use dunkelfeld_io::tiff::write_tiff;

const W: u32 = 13;
const H: u32 = 7;

fn gray8() -> Plane<u8> {
    Plane::from_fn(W, H, |x, y| (x * 19 + y * 3) as u8)
}

fn rgb8() -> Plane<[u8; 3]> {
    Plane::from_fn(W, H, |x, y| [x as u8, y as u8, 255 - (x * y) as u8])
}

fn gray16() -> Plane<u16> {
    Plane::from_fn(W, H, |x, y| (x * 5000 + y) as u16)
}

fn rgb16() -> Plane<[u16; 3]> {
    Plane::from_fn(W, H, |x, y| [(x * 5000) as u16, (y * 9000) as u16, 0x0102])
}

/// Reads `path` with the `image` crate and compares every sample.
fn compare(path: &Path, picture: Picture<'_>) {
    let read = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert_eq!((read.width(), read.height()), picture.size());
    let same = match (picture, &read) {
        (Picture::Gray8(p), image::DynamicImage::ImageLuma8(i)) => i.as_raw() == p.data(),
        (Picture::Rgb8(p), image::DynamicImage::ImageRgb8(i)) => i.as_raw() == p.data().as_flattened(),
        (Picture::Gray16(p), image::DynamicImage::ImageLuma16(i)) => i.as_raw() == p.data(),
        (Picture::Rgb16(p), image::DynamicImage::ImageRgb16(i)) => i.as_raw() == p.data().as_flattened(),
        (_, other) => panic!("{}: read as {:?}", path.display(), other.color()),
    };
    assert!(same, "{}: samples differ", path.display());
}

#[test]
fn every_depth_is_read_as_written_in_png_and_tiff() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (g8, c8, g16, c16) = (gray8(), rgb8(), gray16(), rgb16());
    let pictures = [Picture::Gray8(&g8), Picture::Rgb8(&c8), Picture::Gray16(&g16), Picture::Rgb16(&c16)];
    for (i, picture) in pictures.into_iter().enumerate() {
        let png = folder.path().join(format!("{i}.png"));
        write_png(&png, picture, &[]).expect("written");
        compare(&png, picture);
        let tiff = folder.path().join(format!("{i}.tiff"));
        write_tiff(&tiff, picture, Some("sensor: \"imx250\" ä")).expect("written");
        compare(&tiff, picture);
    }
}

/// The chunks of a PNG by hand: length, name, data, checksum.
fn chunks(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut rest = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n").expect("the signature");
    let mut out = Vec::new();
    while let Some((length, tail)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        out.push((String::from_utf8_lossy(&tail[..4]).into_owned(), tail[4..4 + length].to_vec()));
        rest = &tail[4 + length + 4..];
    }
    out
}

#[test]
fn the_gamma_chunk_states_how_the_picture_is_encoded() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("gamma.png");
    let (g8, g16) = (gray8(), gray16());
    for (picture, gamma) in [(Picture::Gray8(&g8), 45_455u32), (Picture::Gray16(&g16), 100_000)] {
        write_png(&path, picture, &[("Software", "dunkelfeld"), ("Comment", "k = ½")]).expect("written");
        let chunks = chunks(&std::fs::read(&path).expect("readable"));
        let names: Vec<&str> = chunks.iter().map(|(n, _)| n.as_str()).collect();
        let data = |name: &str| chunks.iter().find(|(n, _)| n == name).map(|(_, d)| d.clone());
        assert_eq!(data("gAMA"), Some(gamma.to_be_bytes().to_vec()));
        for absent in ["sRGB", "iCCP", "cICP"] {
            assert!(!names.contains(&absent), "{absent} would overrule gAMA: {names:?}");
        }
        assert_eq!(data("tEXt").as_deref(), Some(&b"Software\0dunkelfeld"[..]));
        assert!(data("iTXt").is_some_and(|t| String::from_utf8_lossy(&t).ends_with("k = ½")));
        let before = names.iter().position(|n| *n == "gAMA") < names.iter().position(|n| *n == "IDAT");
        assert!(before, "{names:?}");
    }
    // 16-bit samples are big-endian: the decoded picture is, and the raw file must be 16 bit.
    let header = chunks(&std::fs::read(&path).expect("readable")).remove(0);
    assert_eq!((header.0.as_str(), header.1[8], header.1[9]), ("IHDR", 16, 0));
}

#[test]
fn the_same_picture_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let plane = rgb8();
    write_png(&a, Picture::Rgb8(&plane), &[("Comment", "x")]).expect("written");
    write_png(&b, Picture::Rgb8(&plane), &[("Comment", "x")]).expect("written");
    assert_eq!(std::fs::read(&a).expect("readable"), std::fs::read(&b).expect("readable"));
}

#[test]
fn an_error_leaves_the_target_as_it_was() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("kept.png");
    std::fs::write(&path, b"precious").expect("written");
    let empty = Plane::<u8>::new(0, 5, 0);
    assert!(write_png(&path, Picture::Gray8(&empty), &[]).is_err());
    assert!(write_png(&path, Picture::Gray8(&gray8()), &[("", "a keyword must not be empty")]).is_err());
    assert!(write_tiff(&path, Picture::Gray8(&empty), None).is_err());
    assert_eq!(std::fs::read(&path).expect("readable"), b"precious");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "no temporary file stays");
}
