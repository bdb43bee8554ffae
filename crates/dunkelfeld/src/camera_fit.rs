//! Combination of lens, film and sensor: the lens of a job, fitted to a camera, determines its rays and the sensor's
//! irradiance.

use dunkelfeld_io::InputError;
use dunkelfeld_io::job::{LensProjection, LensSettings};
use dunkelfeld_render::DEFAULT_F_NUMBER;
use dunkelfeld_scene::camera::lens::{telecentric_aperture, telecentric_f_number};
use dunkelfeld_scene::{Aperture, Blades, Camera, Opening, Projection, ThinLens, Vignetting};

/// The film of a lens.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FilmSize {
    /// Pixels in a row.
    pub(crate) width: u32,
    /// Rows.
    pub(crate) height: u32,
    /// Side of a pixel [m], if it is given.
    pub(crate) pitch: Option<f64>,
}

/// A camera with its lens, and the optical values for the sensor.
#[derive(Clone, Debug)]
pub(crate) struct Fitted {
    pub(crate) camera: Camera,
    /// f-number N in E = pi L tau / (4 N^2 (1 + m)^2).
    pub(crate) f_number: f64,
    /// Magnification m.
    pub(crate) magnification: f64,
}

fn no_size(key: &str) -> InputError {
    let help = "choose a sensor, or write [film] pixel_pitch = \"3.45um\"";
    InputError::of_key(key, "the size of the film is unknown", help)
}

/// Combines a lens with a camera. Values that the settings do not contain remain those of the camera.
///
/// Both sides have the same f-number and magnification. The thin lens of focal length f, at the image distance
/// `v = f (1 + m)`, has a pupil of radius f / (2 N). The pupil gives the sine 1 / (2 N (1 + m)) of the sensor's formula. The
/// telecentric lens has that sine times m on the side of the object.
pub(crate) fn fit(camera: &Camera, lens: &LensSettings, film: FilmSize) -> Result<Fitted, InputError> {
    let mut camera = camera.clone();
    camera.lens.distortion = lens.distortion.unwrap_or(camera.lens.distortion);
    camera.lens.principal_point = lens.principal_point.unwrap_or(camera.lens.principal_point);
    camera.lens.vignetting = lens.vignetting.unwrap_or(camera.lens.vignetting);
    let parallel = match lens.projection {
        None => matches!(camera.projection, Projection::Orthographic { .. }),
        Some(projection) => projection == LensProjection::Telecentric,
    };
    if parallel && lens.vignetting == Some(Vignetting::CosineFourth) {
        let problem = format!("camera \"{}\" is orthographic, and parallel rays have no vignetting", camera.name);
        return Err(InputError::of_key("vignetting", problem, "remove it, or write projection = \"perspective\""));
    }
    let fitted = if parallel { telecentric(camera, lens, film)? } else { perspective(camera, lens, film)? };
    if fitted.magnification > 100.0 {
        let problem = format!("the magnification becomes {:.1}, more than 100", fitted.magnification);
        return Err(InputError::of_key("focus_distance", problem, "write a larger distance"));
    }
    Ok(fitted)
}

fn perspective(mut camera: Camera, lens: &LensSettings, film: FilmSize) -> Result<Fitted, InputError> {
    let f_number = lens.f_number.unwrap_or(DEFAULT_F_NUMBER);
    let mut magnification = lens.magnification.unwrap_or(0.0);
    let film_height = film.pitch.map(|pitch| pitch * f64::from(film.height));
    let field = match (lens.vertical_fov, lens.focal_length, camera.projection) {
        (Some(field), ..) => Some(field),
        (None, Some(focal_length), _) => {
            let height = film_height.ok_or_else(|| no_size("focal_length"))?;
            let image_distance = match lens.focus_distance {
                Some(focus_distance) => ThinLens { focal_length, f_number, focus_distance }.image_distance(),
                None => focal_length * (1.0 + magnification),
            };
            Some(2.0 * (0.5 * height / image_distance).atan())
        }
        (None, None, Projection::Perspective { .. }) => None,
        (None, None, Projection::Orthographic { .. }) => {
            let problem = format!("camera \"{}\" is orthographic and has no field of view to take over", camera.name);
            return Err(InputError::of_key("projection", problem, "write `vertical_fov` or `focal_length` as well"));
        }
    };
    if let Some(field) = field {
        camera.projection = Projection::Perspective { vertical_fov: field as f32 };
    }
    if let (Some(focus_distance), Projection::Perspective { vertical_fov }) = (lens.focus_distance, camera.projection) {
        let height = film_height.ok_or_else(|| no_size("focus_distance"))?;
        let image_distance = 0.5 * height / (0.5 * field.unwrap_or(f64::from(vertical_fov))).tan();
        let thin = ThinLens::from_image_distance(image_distance, f_number, focus_distance);
        magnification = thin.magnification();
        camera.lens.aperture = Some(aperture(Opening::Radius(thin.aperture_radius()), focus_distance, lens));
    }
    Ok(Fitted { camera, f_number, magnification })
}

fn telecentric(mut camera: Camera, lens: &LensSettings, film: FilmSize) -> Result<Fitted, InputError> {
    let aspect = f64::from(film.width) / f64::from(film.height);
    let film_height = film.pitch.map(|pitch| pitch * f64::from(film.height));
    let asked = match (lens.field_height, lens.magnification) {
        (Some(height), _) => Some(height),
        // For an orthographic camera of the scene, the lens determines only the irradiance.
        (None, Some(m)) if m > 0.0 && lens.projection.is_some() => {
            Some(film_height.ok_or_else(|| no_size("magnification"))? / m)
        }
        _ => None,
    };
    let height = match (asked, camera.projection) {
        (Some(height), _) => {
            let (half_width, half_height) = ((0.5 * height * aspect) as f32, (0.5 * height) as f32);
            camera.projection = Projection::Orthographic { half_width, half_height };
            height
        }
        (None, Projection::Orthographic { half_width, half_height }) => {
            2.0 * f64::from(half_height).max(f64::from(half_width) / aspect)
        }
        (None, Projection::Perspective { .. }) => {
            let problem = format!("camera \"{}\" is a perspective and has no field size to take over", camera.name);
            return Err(InputError::of_key(
                "projection",
                problem,
                "write `field_height` or a `magnification` above 0 as well",
            ));
        }
    };
    // An orthographic camera of the scene, with a lens without settings, keeps its magnification: the object is far
    // away.
    let follows = lens.projection.is_some() || lens.focus_distance.is_some();
    let derived = film_height.filter(|_| follows).map(|film_height| film_height / height);
    let magnification = lens.magnification.or(derived).unwrap_or(0.0);
    let f_number = match lens.numerical_aperture {
        // Without a film size there is no sensor either, and the value is not used.
        Some(_) if magnification <= 0.0 => DEFAULT_F_NUMBER,
        Some(sine) => {
            let n = telecentric_f_number(sine, magnification);
            if !(0.5..=1000.0).contains(&n) {
                let problem =
                    format!("at magnification {magnification:.4} it stands for f/{n:.3}, outside f/0.5 to f/1000");
                return Err(InputError::of_key("numerical_aperture", problem, "write one nearer to magnification / 8"));
            }
            n
        }
        None => lens.f_number.unwrap_or(DEFAULT_F_NUMBER),
    };
    if let Some(focus_distance) = lens.focus_distance {
        let sine = match lens.numerical_aperture {
            Some(sine) => sine,
            None if magnification > 0.0 => telecentric_aperture(f_number, magnification),
            None => return Err(no_size("focus_distance")),
        };
        camera.lens.aperture = Some(aperture(Opening::NumericalAperture(sine), focus_distance, lens));
    }
    Ok(Fitted { camera, f_number, magnification })
}

fn aperture(opening: Opening, focus_distance: f64, lens: &LensSettings) -> Aperture {
    let rotation = f64::from(lens.blade_rotation.unwrap_or(0.0));
    Aperture { opening, focus_distance, blades: lens.blades.map(|count| Blades { count, rotation }) }
}
