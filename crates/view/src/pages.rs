//! The pages with the cameras of their pictures, and the statistics of these cameras.

use crate::protocol::{Camera, CertificateState, CurvePoint};

/// The most pages whose cameras are known.
const MAX_PAGES: usize = 8;
/// The most cameras whose statistics are kept.
const MAX_STATISTICS: usize = 8;
/// A page that has asked for none of so many newest films is closed.
const MISSED_FILMS: u64 = 4;
/// The most points of a measured curve.
const MAX_CURVE: usize = 400;

/// A page.
#[derive(Debug)]
struct Page {
    /// The text by which the page names itself.
    key: String,
    /// The camera of its picture, and the last film that it asked for.
    camera: Camera,
    film: u64,
    /// The number of its last analysis; 0 for a camera that has none yet.
    turn: u64,
}

/// The noise of a render behind a camera.
#[derive(Debug)]
pub(crate) struct Statistics {
    /// The camera, without its noise.
    camera: Camera,
    pub(crate) curve: Vec<CurvePoint>,
    pub(crate) certificate: Option<CertificateState>,
}

/// The pages, the one that asked last at the end, and the statistics of their cameras.
#[derive(Debug, Default)]
pub(crate) struct Pages {
    list: Vec<Page>,
    /// Those that were changed last are at the end.
    statistics: Vec<Statistics>,
    /// The number of analyses.
    turns: u64,
    /// The cameras that the film of this number was analysed for, without their devices.
    analysed: (u64, Vec<Camera>),
    /// The camera of the last analysis, without its device.
    last: Option<Camera>,
}

impl Statistics {
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
}

impl Pages {
    /// A page shows a film behind a camera. Returns whether the camera is another one than before.
    pub(crate) fn show(&mut self, key: &str, camera: &Camera, film: u64) -> bool {
        let before = self.list.iter().position(|page| page.key == key).map(|place| self.list.remove(place));
        let turn = before.filter(|page| page.camera == *camera).map(|page| page.turn);
        if self.list.len() >= MAX_PAGES {
            self.list.remove(0);
        }
        self.list.push(Page { key: key.to_owned(), camera: camera.clone(), film, turn: turn.unwrap_or(0) });
        turn.is_none()
    }

    /// The camera of a page; `None` as the key: of the page that asked last.
    pub(crate) fn camera(&self, key: Option<&str>) -> Option<&Camera> {
        let page = match key {
            Some(key) => self.list.iter().find(|page| page.key == key),
            None => self.list.last(),
        };
        page.map(|page| &page.camera)
    }

    /// The pages that are open while the newest film has this number. The last one always is.
    fn open(&mut self, film: u64) -> impl Iterator<Item = &mut Page> {
        let last = self.list.len().saturating_sub(1);
        let pages = self.list.iter_mut().enumerate();
        pages.filter(move |(i, page)| *i == last || page.film + MISSED_FILMS > film).map(|(_, page)| page)
    }

    /// The cameras of the open pages, without their noise, each one once.
    pub(crate) fn cameras(&mut self, film: u64) -> Vec<Camera> {
        let mut cameras: Vec<Camera> = Vec::new();
        for camera in self.open(film).map(|page| page.camera.without_noise()) {
            if !cameras.contains(&camera) {
                cameras.push(camera);
            }
        }
        cameras
    }

    /// The next camera for which the newest film is analysed: that of the open page that has waited longest, and a new camera
    /// before all others. `first` is the camera if no page is open yet. `None` if all are analysed.
    pub(crate) fn next(&mut self, film: u64, first: impl FnOnce() -> Camera) -> Option<Camera> {
        if self.analysed.0 != film {
            self.analysed = (film, Vec::new());
        }
        let (_, done) = std::mem::take(&mut self.analysed);
        let turn = self.turns + 1;
        let camera = if self.list.is_empty() {
            Some(first()).filter(|camera| !done.contains(&camera.without_device()))
        } else {
            let waits = |page: &&mut Page| !done.contains(&page.camera.without_device());
            self.open(film).filter(waits).min_by_key(|page| page.turn).map(|page| {
                page.turn = turn;
                page.camera.clone()
            })
        };
        self.turns += u64::from(camera.is_some());
        self.last = camera.as_ref().map(Camera::without_device);
        self.analysed = (film, done);
        self.analysed.1.extend(self.last.clone());
        camera
    }

    /// A page shows a camera whose results are missing. Analyses the film for it again if it was before: not all results are
    /// kept. Returns whether it was. An analysis for this camera that goes on is not repeated.
    pub(crate) fn analyse_again(&mut self, camera: &Camera) -> bool {
        let key = camera.without_device();
        let done = &mut self.analysed.1;
        let place = done.iter().position(|of| *of == key).filter(|_| self.last.as_ref() != Some(&key));
        place.map(|place| done.remove(place)).is_some()
    }

    /// The statistics of a camera without noise, as far as there are some.
    pub(crate) fn statistics(&self, camera: &Camera) -> Option<&Statistics> {
        self.statistics.iter().find(|of| of.camera == *camera)
    }

    /// The statistics of a camera without noise, to change them.
    pub(crate) fn statistics_mut(&mut self, camera: &Camera) -> &mut Statistics {
        let found =
            self.statistics.iter().position(|of| of.camera == *camera).map(|place| self.statistics.remove(place));
        if self.statistics.len() >= MAX_STATISTICS {
            self.statistics.remove(0);
        }
        let new = || Statistics { camera: camera.clone(), curve: Vec::new(), certificate: None };
        self.statistics.push(found.unwrap_or_else(new));
        let last = self.statistics.len() - 1;
        &mut self.statistics[last]
    }

    /// A render begins: the measured curves begin again. The certificates stay with the picture that is shown.
    pub(crate) fn clear_curves(&mut self) {
        self.statistics.iter_mut().for_each(|of| of.curve.clear());
    }

    /// The picture is that of another render: it has no certificate yet.
    pub(crate) fn clear_certificates(&mut self) {
        self.statistics.iter_mut().for_each(|of| of.certificate = None);
    }

    /// Sets the level of the shares of all curves, with the certificates that are known at this level.
    pub(crate) fn set_target(&mut self, k: f64, known: Vec<(Camera, CertificateState)>) {
        for (camera, state) in known.into_iter().filter(|(_, state)| state.k == k) {
            self.statistics_mut(&camera).certificate = Some(state);
        }
        for Statistics { curve, certificate, .. } in &mut self.statistics {
            for point in curve {
                let exact = certificate.filter(|state| state.film == point.film && state.k == k);
                point.hidden = exact.map_or_else(|| point.shares.at(k), |state| state.hidden);
            }
        }
    }

    /// Sets the exposure of all cameras with a sensor, where the samples are those of one exposure \[s\].
    pub(crate) fn set_exposure(&mut self, time: f64) {
        let is_other = |page: &&mut Page| page.camera.sensor.is_some() && page.camera.exposure != Some(time);
        for page in self.list.iter_mut().filter(is_other) {
            (page.camera.exposure, page.turn) = (Some(time), 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    fn camera(exposure: f64) -> Camera {
        Camera { exposure: Some(exposure), ..Camera::plain(Some("imx250")) }
    }

    fn point(film: u64, k99: f64) -> CurvePoint {
        let shares = Arc::default();
        CurvePoint { seconds: film as f64, spp: 1.0, k99: Some(k99), hidden: 0.0, film, shares }
    }

    #[test]
    fn each_page_has_its_camera_and_its_statistics() {
        let mut pages = Pages::default();
        assert_eq!((pages.camera(None), pages.camera(Some("a"))), (None, None));
        assert!(pages.show("a", &camera(1.0), 1) && pages.show("b", &camera(2.0), 1));
        assert!(!pages.show("a", &camera(1.0), 2), "the same camera");
        assert!(pages.show("a", &camera(3.0), 2));
        assert_eq!(pages.camera(Some("a")), Some(&camera(3.0)));
        assert_eq!(pages.camera(Some("b")), Some(&camera(2.0)));
        assert_eq!((pages.camera(Some("c")), pages.camera(None)), (None, Some(&camera(3.0))));
        pages.statistics_mut(&camera(2.0)).add_point(point(1, 0.7));
        pages.statistics_mut(&camera(3.0)).add_point(point(1, 0.4));
        let level = |pages: &Pages, time| pages.statistics(&camera(time)).map(|of| of.is_reached(0.5));
        assert_eq!((level(&pages, 1.0), level(&pages, 2.0), level(&pages, 3.0)), (None, Some(false), Some(true)));
        // A camera of many keeps its statistics if it is used.
        for number in 0..20 {
            pages.statistics_mut(&camera(3.0));
            pages.statistics_mut(&camera(100.0 + f64::from(number)));
        }
        assert_eq!((level(&pages, 2.0), level(&pages, 3.0)), (None, Some(true)));
        pages.clear_curves();
        assert_eq!(level(&pages, 3.0), Some(false));
    }

    #[test]
    fn pages_are_analysed_in_turns() {
        let mut pages = Pages::default();
        let next = |pages: &mut Pages, film| pages.next(film, || camera(9.0)).and_then(|camera| camera.exposure);
        // Before a page: the camera of the job, once for each film.
        assert_eq!([1, 1, 2].map(|film| next(&mut pages, film)), [Some(9.0), None, Some(9.0)]);
        pages.show("a", &camera(1.0), 2);
        pages.show("b", &camera(2.0), 2);
        assert_eq!([2, 2, 2].map(|film| next(&mut pages, film)), [Some(1.0), Some(2.0), None]);
        // Each new film takes one analysis: the pages take turns, and a new camera comes first.
        assert_eq!([3, 4, 5].map(|film| next(&mut pages, film)), [Some(1.0), Some(2.0), Some(1.0)]);
        pages.show("b", &camera(2.0), 5);
        pages.show("a", &camera(5.0), 5);
        assert_eq!([5, 5, 5].map(|film| next(&mut pages, film)), [Some(5.0), Some(2.0), None]);
        // Results that were not kept are computed again, except while their analysis goes on.
        assert!(pages.analyse_again(&camera(5.0)) && !pages.analyse_again(&camera(5.0)));
        assert_eq!([5, 5].map(|film| next(&mut pages, film)), [Some(5.0), None]);
        assert!(!pages.analyse_again(&camera(6.0)), "no analysis yet");
        pages.analyse_again(&camera(5.0));
        assert_eq!(next(&mut pages, 5), Some(5.0));
        assert!(!pages.analyse_again(&camera(5.0)), "it goes on");
        assert_eq!(next(&mut pages, 5), None);
        // A device needs no other analysis.
        pages.show("a", &Camera { device: 7, ..camera(5.0) }, 5);
        assert_eq!(next(&mut pages, 5), None);
        // A page that asks for no newer film is closed, unless it was the last one.
        pages.show("a", &camera(5.0), 20);
        assert_eq!([20, 20].map(|film| next(&mut pages, film)), [Some(5.0), None]);
        assert_eq!(pages.cameras(20), [camera(5.0)]);
        assert_eq!(next(&mut pages, 40), Some(5.0));
    }

    /// Samples for one exposure: all cameras have it, and those without a sensor have none.
    #[test]
    fn a_timed_exposure_is_that_of_all_pages() {
        let mut pages = Pages::default();
        let none = Camera { sensor: None, ..camera(2.0) };
        pages.show("a", &camera(1.0), 1);
        pages.show("b", &none, 1);
        pages.set_exposure(5.0);
        assert_eq!((pages.camera(Some("a")), pages.camera(Some("b"))), (Some(&camera(5.0)), Some(&none)));
    }
}
