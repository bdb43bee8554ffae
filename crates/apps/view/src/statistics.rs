//! The noise of the render behind one camera: that of the picture whose knobs a page has changed last.

use crate::protocol::{Camera, CertificateState, CurvePoint};

/// The most points of a measured curve.
const MAX_CURVE: usize = 400;

/// The camera of the statistics, and what is measured behind it.
#[derive(Debug, Default)]
pub(crate) struct Statistics {
    /// `None` until a page shows a picture.
    shown: Option<Camera>,
    /// The camera of curve and certificate, without its noise.
    measured: Option<Camera>,
    pub(crate) curve: Vec<CurvePoint>,
    pub(crate) certificate: Option<CertificateState>,
    /// The last film that was analysed, and its camera without the device.
    analysed: Option<(u64, Camera)>,
}

impl Statistics {
    /// The camera that a page has shown last.
    pub(crate) fn shown(&self) -> Option<&Camera> {
        self.shown.as_ref()
    }

    /// A page shows a camera. Returns whether it is another one than before.
    pub(crate) fn show(&mut self, camera: &Camera) -> bool {
        self.shown.replace(camera.clone()).as_ref() != Some(camera)
    }

    /// Takes the camera, or `first` before that of a page, if the film with this number is not analysed for it yet.
    pub(crate) fn next(&mut self, film: u64, first: impl FnOnce() -> Camera) -> Option<Camera> {
        let camera = self.shown.clone().unwrap_or_else(first);
        let work = Some((film, camera.without_device()));
        if self.analysed == work {
            return None;
        }
        self.analysed = work;
        Some(camera)
    }

    /// These statistics, if they are those of a camera without noise.
    pub(crate) fn of(&self, camera: &Camera) -> Option<&Self> {
        (self.measured.as_ref() == Some(camera)).then_some(self)
    }

    /// Measures a camera without noise: the statistics of another one are dropped.
    pub(crate) fn measure(&mut self, camera: &Camera) -> &mut Self {
        if self.measured.as_ref() != Some(camera) {
            (self.measured, self.certificate) = (Some(camera.clone()), None);
            self.curve.clear();
        }
        self
    }

    /// Adds a point of the measured curve. A long curve loses every second of its earlier points.
    pub(crate) fn add_point(&mut self, point: CurvePoint) {
        if self.curve.len() >= MAX_CURVE {
            let mut number = 0;
            self.curve.retain(|_| {
                number += 1;
                number % 2 == 0
            });
        }
        self.curve.push(point);
    }

    /// Has the camera reached the level?
    pub(crate) fn is_reached(&self, k: f64) -> bool {
        self.curve.last().is_some_and(|point| point.k99.is_some_and(|k99| k99 <= k))
    }

    /// Sets the exposure of a camera with a sensor, where the samples are those of one exposure \[s\].
    pub(crate) fn set_exposure(&mut self, time: f64) {
        if let Some(camera) = self.shown.as_mut().filter(|camera| camera.sensor.is_some()) {
            camera.exposure = Some(time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(exposure: f64) -> Camera {
        Camera { exposure: Some(exposure), ..Camera::plain(Some("imx250")) }
    }

    fn point(film: u64, k99: f64) -> CurvePoint {
        CurvePoint { seconds: film as f64, spp: 1.0, k99: Some(k99), film }
    }

    #[test]
    fn statistics_are_those_of_one_camera() {
        let mut statistics = Statistics::default();
        statistics.measure(&camera(1.0)).add_point(point(1, 0.4));
        let level = |statistics: &Statistics, time| statistics.of(&camera(time)).map(|of| of.is_reached(0.5));
        assert_eq!((level(&statistics, 1.0), level(&statistics, 2.0)), (Some(true), None));
        // The same camera keeps its points, another one begins again.
        statistics.measure(&camera(1.0)).add_point(point(2, 0.3));
        assert_eq!(statistics.curve.len(), 2);
        statistics.measure(&camera(2.0));
        assert_eq!((level(&statistics, 1.0), level(&statistics, 2.0)), (None, Some(false)));
    }

    #[test]
    fn each_film_is_analysed_once_for_the_camera_of_the_last_page() {
        let mut statistics = Statistics::default();
        let next = |of: &mut Statistics, film| of.next(film, || camera(9.0)).and_then(|camera| camera.exposure);
        assert_eq!([1, 1, 2].map(|film| next(&mut statistics, film)), [Some(9.0), None, Some(9.0)]);
        assert!(statistics.show(&camera(1.0)) && !statistics.show(&camera(1.0)));
        assert_eq!([2, 2].map(|film| next(&mut statistics, film)), [Some(1.0), None]);
        // A device needs no other analysis.
        assert!(statistics.show(&Camera { device: 7, ..camera(1.0) }));
        assert_eq!(next(&mut statistics, 2), None);
        // A camera of before is analysed again: not all of its results are kept.
        statistics.show(&camera(2.0));
        assert_eq!(next(&mut statistics, 2), Some(2.0));
        statistics.show(&camera(1.0));
        assert_eq!(next(&mut statistics, 2), Some(1.0));
    }

    /// Samples for one exposure: a camera with a sensor has it.
    #[test]
    fn a_timed_exposure_is_that_of_the_camera() {
        let none = Camera { sensor: None, ..camera(2.0) };
        for (before, after) in [(camera(1.0), camera(5.0)), (none.clone(), none)] {
            let mut statistics = Statistics::default();
            statistics.show(&before);
            statistics.set_exposure(5.0);
            assert_eq!(statistics.shown(), Some(&after));
        }
    }
}
