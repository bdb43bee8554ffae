//! Maps of the pixels of one camera, measured: they replace the pattern that a seed draws.

use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use dunkelfeld_film::Plane;

use crate::error::SensorError;
use crate::pattern::PixelPattern;

/// The largest response in a map, relative to the mean.
const LARGEST_RESPONSE: f32 = 100.0;

/// Measured maps of the pixels of one camera. All have the size of the sensor.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PixelMaps {
    /// Dark signal of each pixel less the mean \[e-\]: in place of the DSNU that a seed draws.
    pub dsnu: Option<PixelMap>,
    /// Response of each pixel to light over the mean: in place of the PRNU that a seed draws.
    pub prnu: Option<PixelMap>,
    /// Another factor of the response of each pixel: lens shading and uneven light.
    pub flat_field: Option<PixelMap>,
}

/// A finite number for each pixel, shared by all copies. Its serialised form has the values as base64 of little-endian bytes.
#[derive(Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(into = "Packed", try_from = "Packed")]
pub struct PixelMap(Arc<Plane<f32>>);

#[derive(serde::Serialize, serde::Deserialize)]
struct Packed {
    width: u32,
    height: u32,
    values: String,
}

impl PixelMap {
    /// A map of these values.
    ///
    /// # Errors
    /// A value that is not finite, in words with its place.
    pub fn new(values: Plane<f32>) -> Result<Self, String> {
        match values.data().iter().position(|v| !v.is_finite()) {
            None => Ok(Self(Arc::new(values))),
            Some(at) => {
                let (at, width) = (at as u32, values.width());
                Err(format!("is not a finite number at column {}, row {}", at % width, at / width))
            }
        }
    }

    /// The values.
    pub fn values(&self) -> &Plane<f32> {
        &self.0
    }
}

impl From<PixelMap> for Packed {
    fn from(PixelMap(plane): PixelMap) -> Self {
        let bytes: Vec<u8> = plane.data().iter().flat_map(|v| v.to_le_bytes()).collect();
        Self { width: plane.width(), height: plane.height(), values: BASE64.encode(bytes) }
    }
}

impl TryFrom<Packed> for PixelMap {
    type Error = String;

    fn try_from(packed: Packed) -> Result<Self, String> {
        let bytes = BASE64.decode(packed.values).map_err(|e| e.to_string())?;
        let values = bytes.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect();
        let plane = Plane::from_vec(packed.width, packed.height, values);
        Self::new(plane.ok_or("has more or fewer values than pixels")?)
    }
}

impl std::fmt::Debug for PixelMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PixelMap({} x {})", self.0.width(), self.0.height())
    }
}

impl PixelMaps {
    /// The maps with their names.
    fn named(&self) -> impl Iterator<Item = (&'static str, &Plane<f32>)> {
        let all = [("dsnu_map", &self.dsnu), ("prnu_map", &self.prnu), ("flat_field", &self.flat_field)];
        all.into_iter().filter_map(|(name, map)| Some((name, map.as_ref()?.values())))
    }

    /// The key of the first map in a sensor file; `None` without a map.
    pub(crate) fn name(&self) -> Option<&'static str> {
        self.named().next().map(|(name, _)| name)
    }

    /// Columns and rows; `None` without a map.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.named().next().map(|(_, map)| [map.width(), map.height()])
    }

    /// Checks that all maps have the size of the sensor, and that the responses are from 0 to 100.
    pub(crate) fn check(&self, resolution: Option<[u32; 2]>) -> Result<(), SensorError> {
        for (name, map) in self.named() {
            let size = [map.width(), map.height()];
            let fault = |problem: String| Err(SensorError::Map { name, problem });
            if let Some([width, height]) = resolution.or(self.size()).filter(|wanted| *wanted != size) {
                return fault(format!("has {} x {} pixels, the sensor {width} x {height}", size[0], size[1]));
            }
            let is_response = |v: &f32| (0.0..=LARGEST_RESPONSE).contains(v);
            if let Some(value) = map.data().iter().find(|v| name != "dsnu_map" && !is_response(v)) {
                return fault(format!("has the response {value}, which must be from 0 to {LARGEST_RESPONSE}"));
            }
        }
        Ok(())
    }

    /// Adds the maps to a pattern of their size. It stays empty without a map.
    pub(crate) fn apply(&self, pixels: &mut Vec<PixelPattern>) {
        for (name, map) in self.named() {
            pixels.resize(map.data().len(), PixelPattern::NONE);
            for (pixel, value) in pixels.iter_mut().zip(map.data()) {
                if name == "dsnu_map" { pixel.dark += value } else { pixel.response *= value }
            }
        }
    }
}
