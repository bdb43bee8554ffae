//! Sensor files and presets: their values, derived figures, and errors.

use std::path::Path;

use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::sensor_file::{find_sensor, load_sensor, parse_sensor, preset, preset_names};
use dunkelfeld_io::tiff::{write_map, write_tiff};
use dunkelfeld_io::toml_file::TomlFile;
use dunkelfeld_sensor::{BayerPattern, PixelMap, SensorModel, data_sheet};

const EXAMPLE: &str = r#"name = "test"
source = "made up"
derived = ["gain_e_per_dn"]
bit_depth = 12
pixel_pitch_um = 3.45
quantum_efficiency = [[450, 0.5], [550, 0.65]]
full_well_e = 10_000
dark_noise_e = 4.0
gain_e_per_dn = 4
offset_dn = 60
prnu_percent = 0.5
temperature_c = 42

[dark_current]
e_per_s = 3
at_c = 35
doubling_k = 7
"#;

fn parse(text: &str) -> Result<SensorModel, dunkelfeld_io::InputError> {
    parse_sensor(&TomlFile::from_text("test.toml", text))
}

#[test]
fn every_value_arrives_in_its_unit() {
    let model = parse(EXAMPLE).expect("valid");
    let s = model.spec();
    assert!((s.pixel_pitch.0 - 3.45e-6).abs() < 1e-18);
    assert_eq!(s.system_gain, 0.25);
    assert_eq!(s.fixed_pattern.prnu, 0.005);
    assert_eq!(s.fixed_pattern.dsnu.0, 0.0);
    assert_eq!((s.temperature.0, s.dark_current.reference.0, s.dark_current.rate), (42.0, 35.0, 3.0));
    assert_eq!(s.quantum_efficiency.curves()[0].points().len(), 2);
    assert_eq!(s.derived, ["gain_e_per_dn"]);
    let reciprocal = parse(&EXAMPLE.replace("gain_e_per_dn = 4", "gain_dn_per_e = 0.25")).expect("valid");
    assert_eq!(reciprocal.spec().system_gain, 0.25);
}

/// A colour sensor with every key that a sensor can have.
const COLOUR: &str = r#"name = "test"
source = "made up"
derived = ["color_filter"]
assumed = ["row_noise_e", "defects"]
bit_depth = 12
pixel_pitch_um = 3.45
full_well_e = 10_000
dark_noise_e = 4.0
row_noise_e = 0.5
gain_e_per_dn = 4
offset_dn = 60
dsnu_e = 1.5
dsnu_row_e = 0.3
dsnu_column_e = 0.4
prnu_percent = 0.5
prnu_row_percent = 0.1
prnu_column_percent = 0.2

[dark_current]
e_per_s = 3
at_c = 35
doubling_k = 7

[color_filter]
pattern = "grbg"
red = [[610, 0.45]]
green = [[530, 0.58], [610, 0.1]]
blue = [[465, 0.52]]
white_balance = false

[defects]
hot_per_million = 20
hot_dark_current_factor = 50
dead_per_million = 3

[published]
quantum_efficiency_percent = 58
dsnu_e = 1.4
"#;

#[test]
fn a_colour_sensor_with_all_its_faults_arrives() {
    let model = parse(COLOUR).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    let s = model.spec();
    let filter = s.quantum_efficiency.filter().expect("a filter");
    assert_eq!((filter.pattern, filter.white_balance), (BayerPattern::Grbg, false));
    let points: Vec<usize> = filter.curves.iter().map(|c| c.points().len()).collect();
    assert_eq!(points, [1, 2, 1]);
    assert_eq!(s.quantum_efficiency.of_pixel(1, 0).points()[0].1, 0.45, "red is the second pixel of the first row");
    let p = &s.fixed_pattern;
    assert_eq!((p.dsnu.0, p.dsnu_row.0, p.dsnu_column.0), (1.5, 0.3, 0.4));
    assert_eq!((p.prnu, p.prnu_row, p.prnu_column), (0.005, 0.001, 0.002));
    // 1.5^2 = 0.3^2 + 0.4^2 + pixel^2, and 4^2 = 0.5^2 + pixel^2.
    assert!((p.dsnu_pixel().0 - 2.0f64.sqrt()).abs() < 1e-12 && (p.prnu_pixel() - 20e-6f64.sqrt()).abs() < 1e-12);
    assert!((model.pixel_dark_noise().0 - 15.75f64.sqrt()).abs() < 1e-12);
    assert_eq!((s.row_noise.0, s.defects.hot, s.defects.hot_factor, s.defects.dead), (0.5, 20e-6, 50.0, 3e-6));
    assert_eq!((s.published.quantum_efficiency_percent, s.published.dsnu_e), (Some(58.0), Some(1.4)));
    let sheet = data_sheet(&model);
    let colors: Vec<_> = sheet.channels.iter().map(|c| (c.color.map(|c| c.name()), c.wavelength.0)).collect();
    assert_eq!(colors, [(Some("red"), 610.0), (Some("green"), 530.0), (Some("blue"), 465.0)]);
    assert_eq!((sheet.quantum_efficiency, sheet.wavelength.0), (0.58, 530.0));
    let default = parse(&COLOUR.replace("white_balance = false\n", "")).expect("valid");
    assert!(default.spec().quantum_efficiency.filter().is_some_and(|f| f.white_balance));
}

/// A replacement in a file, the text at the caret, and a part of the message.
type Mistake = (&'static str, &'static str, &'static str, &'static str);

const MISTAKES: &[Mistake] = &[
    ("bit_depth = 12", "bit_depth = 24", "24", "from 8 to 16"),
    ("bit_depth = 12", "bit_depth = 12.5", "12.5", "from 8 to 16"),
    ("bit_depth = 12", "bit_depth = 12\nresolution = [0, 7]", "[0, 7]", "this is no resolution"),
    ("pixel_pitch_um = 3.45", "pixel_pitch_um = 0", "0", "0.1 to 1000 um"),
    ("full_well_e = 10_000", "full_well_e = nan", "nan", "out of range"),
    ("dark_noise_e = 4.0", "dark_noise_e = -4.0", "-4.0", "full well"),
    ("gain_e_per_dn = 4", "gain_e_per_dn = 0", "0", "positive"),
    ("offset_dn = 60", "offset_dn = 4095", "4095", "90 %"),
    ("prnu_percent = 0.5", "prnu_percent = 200", "200", "0 to 100 %"),
    ("doubling_k = 7", "doubling_k = 0", "0", "1 to 100 K"),
    ("[450, 0.5]", "[450, 50]", "[[450, 50], [550, 0.65]]", "quantum_efficiency"),
    ("[450, 0.5]", "[650, 0.5]", "[[650, 0.5], [550, 0.65]]", "ascend"),
    ("[\"gain_e_per_dn\"]", "[\"gain\"]", "\"gain\"", "not a key"),
    ("offset_dn = 60", "offset_dn = 60\nofset = 1", "ofset", "ofset"),
    ("offset_dn = 60", "offset_dn = 60\ngain_dn_per_e = 0.25", "0.25", "twice"),
    ("row_noise_e = 0.5", "row_noise_e = 4.5", "4.5", "dark noise"),
    ("dsnu_row_e = 0.3", "dsnu_row_e = 1.6", "1.6", "total"),
    ("dsnu_column_e = 0.4", "dsnu_column_e = 1.48", "1.48", "rows leaves"),
    ("prnu_row_percent = 0.1", "prnu_row_percent = -0.1", "-0.1", "total"),
    ("prnu_column_percent = 0.2", "prnu_column_percent = inf", "inf", "rows leaves"),
    ("\"grbg\"", "\"RGGB\"", "\"RGGB\"", "\"rggb\""),
    ("red = [[610, 0.45]]", "red = []", "[]", "at least one point"),
    ("[[465, 0.52]]", "[[465, 1.52]]", "[[465, 1.52]]", "fraction"),
    ("row_noise_e = 0.5", "quantum_efficiency = [[5e2, 0.5]]", "[[5e2, 0.5]]", "remove"),
    ("hot_per_million = 20", "hot_per_million = 2e5", "2e5", "100 000"),
    ("hot_dark_current_factor = 50", "hot_dark_current_factor = 0", "0", "from 1"),
    ("dead_per_million = 3", "dead_per_million = nan", "nan", "100 000"),
    ("dsnu_e = 1.4", "dsnu_e = 0", "0", "above 0"),
    ("white_balance = false", "balance = false", "balance", "balance"),
];

#[test]
fn a_mistake_is_shown_at_its_place() {
    for (from, to, marked, part) in MISTAKES {
        let example = if EXAMPLE.contains(from) { EXAMPLE } else { COLOUR };
        let text = example.replace(from, to);
        assert_ne!(text, example, "{from}");
        let error = parse(&text).expect_err(to);
        let message = error.to_string();
        assert!(message.contains(part), "{to}: {message}");
        let span = error.source_span.as_deref().unwrap_or_else(|| panic!("{to}: no place: {message}"));
        assert_eq!(&span.text[span.range.clone()], *marked, "{to}: {message}");
    }
    let cold = parse(&COLOUR.replace("e_per_s = 3", "e_per_s = 0")).expect_err("hot pixels without a dark current");
    assert!(cold.place.contains("hot") && cold.to_string().contains("without a dark current"), "{cold}");
    let keys = ["name", "bit_depth", "quantum_efficiency", "full_well_e", "gain_e_per_dn", "offset_dn"];
    let keys = keys.map(|key| (EXAMPLE, key)).into_iter();
    for (example, key) in keys.chain(["pattern", "red", "green", "blue"].map(|key| (COLOUR, key))) {
        let without: String = example.lines().filter(|l| !l.starts_with(key)).map(|l| format!("{l}\n")).collect();
        let message = parse(&without).expect_err(key).to_string();
        assert!(message.contains(key), "{key}: {message}");
    }
}

#[test]
fn names_and_files_are_distinguished() {
    assert!(find_sensor("imx250").is_ok());
    let unknown = find_sensor("imx999").expect_err("no such preset").to_string();
    assert!(unknown.contains("imx250") && unknown.contains("imx999"), "{unknown}");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mine.toml");
    let missing = find_sensor(&path.to_string_lossy()).expect_err("no such file").to_string();
    assert!(missing.contains("mine.toml"), "{missing}");
    std::fs::write(&path, EXAMPLE).expect("written");
    assert_eq!(find_sensor(&path.to_string_lossy()), load_sensor(&path));
    assert!(load_sensor(&path).is_ok());
    assert!(load_sensor(Path::new("/")).is_err());
}

/// Maps are beside the file, have its size, and come back bit for bit.
#[test]
fn maps_are_read_and_faults_in_them_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let map = |width, height, value: f32| {
        PixelMap::new(Plane::from_fn(width, height, |x, y| value + x as f32 * 0.1 - y as f32)).expect("finite")
    };
    let dsnu = map(6, 4, -0.3);
    write_map(&at("dsnu.tif"), &dsnu, "e-").expect("written");
    write_map(&at("small.tif"), &map(5, 4, 9.0), "1").expect("written");
    write_tiff(&at("whole.tif"), Picture::Gray16(&Plane::new(6, 4, 1)), None).expect("written");
    let bytes = std::fs::read(at("dsnu.tif")).expect("there");
    // The first value becomes a NaN.
    let first = bytes.windows(4).position(|w| w == (-0.3f32).to_le_bytes()).expect("the first value");
    let nan = [&bytes[..first], &f32::NAN.to_le_bytes(), &bytes[first + 4..]].concat();
    std::fs::write(at("nan.tif"), nan).expect("written");
    std::fs::write(at("short.tif"), &bytes[..first + 8]).expect("written");
    let read = |keys: &str| {
        std::fs::write(at("mine.toml"), EXAMPLE.replace("temperature_c", &format!("{keys}\ntemperature_c")))
            .expect("written");
        load_sensor(&at("mine.toml"))
    };
    let model = read("dsnu_map = \"dsnu.tif\"").unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(model.spec().fixed_pattern.maps.dsnu, Some(dsnu));
    assert_eq!(model.spec().resolution, Some([6, 4]));
    for (keys, problem) in [
        ("dsnu_map = \"dsnu.tif\"\nprnu_map = \"small.tif\"", "5 x 4 pixels, the sensor 6 x 4"),
        ("dsnu_map = \"dsnu.tif\"\nresolution = [7, 4]", "6 x 4 pixels, the sensor 7 x 4"),
        ("prnu_map = \"dsnu.tif\"", "the response -0.3"),
        ("dsnu_map = \"nan.tif\"", "not a finite number at column 0, row 0"),
        ("dsnu_map = \"whole.tif\"", "not one channel of 32-bit floats"),
        ("dsnu_map = \"short.tif\"", "short.tif"),
        ("dsnu_map = \"mine.toml\"", "mine.toml"),
        ("dsnu_map = \"no.tif\"", "no.tif"),
    ] {
        let error = read(keys).expect_err(keys);
        assert!(error.to_string().contains(problem) && !error.help.is_empty(), "{keys}: {error}");
    }
}

/// The derived figures of each preset against the published ones.
///
/// Dynamic range: older data sheets leave out the rounding noise and the half electrons of release 4.0, equation (27), so
/// the published figure must lie between release 4.0 (the lowest) and saturation over dark noise (the highest), to 0.1 dB.
#[test]
fn presets_imply_what_was_published() {
    let names: Vec<_> = preset_names().collect();
    assert_eq!(names.len(), 8);
    for name in names {
        let model = preset(name).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
        let sheet = data_sheet(&model);
        let s = model.spec();
        let highest = 20.0 * (sheet.saturation.0 / sheet.dark_noise.0).log10();
        if let Some(published) = sheet.published.dynamic_range_db {
            assert!(
                (sheet.dynamic_range_db - 0.1..highest + 0.1).contains(&published),
                "{name}: {published} dB published, the model has {:.2} to {highest:.2}",
                sheet.dynamic_range_db
            );
        }
        assert!(model.exposure_range()[0].0 >= 4e-6, "{name} has no least exposure");
        if let Some(snr) = sheet.published.snr_max_db {
            assert!((sheet.snr_max_db - snr).abs() < 0.05, "{name}: SNR {:.2} dB, published {snr}", sheet.snr_max_db);
        }
        // The published saturation is reached before the converter ends, and no dark pixel is cut off.
        assert!((sheet.saturation.0 - s.full_well.0).abs() < 0.5, "{name}: saturates at {}", sheet.saturation);
        let dark_dn = s.system_gain * s.dark_noise.0.hypot(s.fixed_pattern.dsnu.0);
        assert!(s.offset.0 > 6.0 * dark_dn, "{name}: offset {}, dark noise {dark_dn:.2} DN", s.offset);
        assert!(!s.source.is_empty() && !s.assumed.is_empty(), "{name} must have the sources of its numbers");
    }
}

/// The report of the IMX900 at low gain follows the current rules, so the model must reproduce it to the last digit.
#[test]
fn the_imx900_reproduces_its_report() {
    let sheet = data_sheet(&preset("imx900-lcg").expect("a preset"));
    assert!((sheet.dynamic_range_db - 63.77).abs() < 0.005, "{:.3} dB", sheet.dynamic_range_db);
    assert!((sheet.snr_max_db - 39.76).abs() < 0.005, "{:.3} dB", sheet.snr_max_db);
}
