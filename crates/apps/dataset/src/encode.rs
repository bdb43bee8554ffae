//! The files of an image: pictures, layers of labels, annotations.

use crate::coco::{Annotation, CompressedRle, Segmentation as Shape};
use crate::hull::{convex_hull, smallest_rectangle};
use crate::ids::Ids;
use crate::keypoints::InstancePoints;
use crate::labels::LabelPlanes;
use crate::outline::outline;
use crate::pinhole::Pinhole;
use crate::pose::Pose;
use crate::record::InstanceRecord;
use crate::rle::runs_of_labels;
use crate::study::{ImageSettings, LabelSettings, LinearFormat, PictureFormat, Segmentation, Yolo};
use dunkelfeld::outputs::encode_picture;
use dunkelfeld::{Error, Frame};
use dunkelfeld_film::Plane;
use dunkelfeld_io::jpeg::jpeg_bytes;
use dunkelfeld_io::picture::Picture as File;
use dunkelfeld_io::png::png_bytes;
use dunkelfeld_io::tiff::tiff_bytes;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Unit of depth images \[m\].
pub(crate) const DEPTH_UNIT: f32 = 1e-4;

/// Files by their names in the folder of the set.
pub(crate) type Files = Vec<(String, Vec<u8>)>;

/// The labels of an image, from which the files of the whole set are put together.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ImageLabels {
    pub(crate) index: u64,
    /// The image that the labels are of, relative to the folder of the set; empty if none is written.
    pub(crate) file_name: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) annotations: Vec<Annotation>,
    /// The camera without its lens errors; `None` for a telecentric lens and a line scan.
    pub(crate) camera: Option<Pinhole>,
    pub(crate) poses: Vec<Pose>,
    /// The key points of all objects of the image that have some, also of hidden ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) keypoints: Vec<InstancePoints>,
}

pub(crate) fn encoded(what: &str, result: std::io::Result<Vec<u8>>) -> Result<Vec<u8>, Error> {
    result.map_err(|e| Error::setting(what, e.to_string(), "use another format or size"))
}

/// The images of a frame.
pub(crate) fn images(files: &mut Files, name: &str, settings: &ImageSettings, frame: &Frame) -> Result<(), Error> {
    match settings.picture {
        PictureFormat::None => {}
        PictureFormat::Png => files.push((format!("images/{name}.png"), encode_picture(&frame.picture)?)),
        PictureFormat::Jpeg => {
            let bytes = jpeg_bytes(frame.picture.as_file(), settings.quality);
            files.push((format!("images/{name}.jpg"), encoded("picture", bytes)?));
        }
    }
    if settings.linear == LinearFormat::None && !settings.raw {
        return Ok(());
    }
    let Some(sensor) = &frame.sensor else {
        return Err(Error::setting(
            "study.images",
            "there is no sensor, so there are no grey values",
            "choose a sensor",
        ));
    };
    match settings.linear {
        LinearFormat::None => {}
        LinearFormat::Png => {
            files.push((format!("linear/{name}.png"), encoded("linear", png_bytes(File::Gray16(&sensor.values)))?));
        }
        LinearFormat::Tiff => {
            let bytes = tiff_bytes(File::Gray16(&sensor.values), None);
            files.push((format!("linear/{name}.tif"), encoded("linear", bytes)?));
        }
    }
    if settings.raw {
        let bytes = sensor.values.data().iter().flat_map(|v| v.to_le_bytes()).collect();
        files.push((format!("raw/{name}.raw"), bytes));
    }
    Ok(())
}

/// The layers of labels. `categories` are those of the instances.
pub(crate) fn labels(
    files: &mut Files,
    name: &str,
    settings: &LabelSettings,
    planes: &LabelPlanes,
    categories: &BTreeMap<u16, u16>,
) -> Result<(), Error> {
    if settings.masks {
        files.push((format!("masks/{name}.png"), encoded("masks", png_bytes(File::Gray16(&planes.instances)))?));
    }
    if settings.semantic {
        // The ids of instances are sparse: a table is faster than a map.
        let mut table = vec![0u8; usize::from(u16::MAX) + 1];
        for (instance, category) in categories {
            table[usize::from(*instance)] = u8::try_from(*category).unwrap_or(u8::MAX);
        }
        let plane = planes.instances.map(|id| table[usize::from(*id)]);
        files.push((format!("semantic/{name}.png"), encoded("semantic", png_bytes(File::Gray8(&plane)))?));
    }
    if let Some(coverage) = &planes.coverage {
        files.push((format!("coverage/{name}.png"), encoded("coverage", png_bytes(File::Gray16(coverage)))?));
    }
    if let Some(depth) = &planes.depth {
        let in_range = |d: f32| if (0.0..=65535.0).contains(&d) { d as u16 } else { 0 };
        let units: Plane<u16> = depth.map(|d| in_range((d / DEPTH_UNIT).round()));
        files.push((format!("depth/{name}.png"), encoded("depth", png_bytes(File::Gray16(&units)))?));
    }
    if let Some(normals) = &planes.normals {
        let units: Plane<[u16; 3]> = normals.map(|n| match n {
            [0.0, 0.0, 0.0] => [0; 3],
            n => n.map(|v| ((v * 32767.0).round() + 32768.0) as u16),
        });
        files.push((format!("normals/{name}.png"), encoded("normals", png_bytes(File::Rgb16(&units)))?));
    }
    Ok(())
}

/// The annotations of an image, without numbers. Instances without a visible pixel have none. A defect in a category with
/// key points has points that are not labelled, as readers of COCO expect the field then.
pub(crate) fn annotations(
    index: u64,
    settings: &LabelSettings,
    planes: &LabelPlanes,
    instances: &[InstanceRecord],
    points: &[InstancePoints],
    ids: &Ids,
) -> Vec<Annotation> {
    if settings.coco == Segmentation::None {
        return Vec::new();
    }
    let mask = &planes.instances;
    let width = mask.width();
    let runs = runs_of_labels(mask);
    (instances.iter())
        .filter_map(|record| {
            let rle = runs.get(&record.id)?;
            let points = points.iter().find(|points| points.instance == record.id);
            let count = ids.keypoint_count(record.category);
            let is_inside = |x: usize, y: usize| mask.data().get(y * width as usize + x) == Some(&record.id);
            let polygons = match settings.coco {
                Segmentation::Polygon => outline(record.bbox, is_inside).exact(),
                _ => None,
            };
            let segmentation = polygons.map_or_else(|| Shape::Rle(CompressedRle::from(rle)), Shape::Polygons);
            Some(Annotation {
                id: 0,
                image_id: index,
                category_id: u32::from(record.category),
                segmentation,
                area: f64::from(rle.area()),
                bbox: record.bbox.map(f64::from),
                iscrowd: 0,
                instance: u64::from(record.id),
                name: record.name.clone(),
                visible_fraction: if record.amodal > 0.0 { (record.visible / record.amodal).min(1.0) } else { 0.0 },
                cnr: record.cnr,
                size_mm: record.size_mm,
                keypoints: points.map(InstancePoints::coco).or_else(|| (count > 0).then(|| vec![0.0; 3 * count])),
                num_keypoints: points.map(InstancePoints::in_film).or((count > 0).then_some(0)),
            })
        })
        .collect()
}

/// The lines of YOLO of an image: the class is the id of the category less one. Behind the box there are `count` key
/// points. An instance without key points, as a defect, has zeros there: points that are not labelled.
pub(crate) fn yolo(
    shapes: Yolo,
    mask: &Plane<u16>,
    instances: &[InstanceRecord],
    points: &[InstancePoints],
    count: usize,
) -> String {
    let size @ [width, height] = [mask.width(), mask.height()];
    let lines = instances.iter().filter(|record| record.area > 0).filter_map(|record| {
        let class = usize::from(record.category).checked_sub(1)?;
        let inside = |x: usize, y: usize| mask.data().get(y * width as usize + x) == Some(&record.id);
        let outlines = || outline(record.bbox, inside).polygons;
        match shapes {
            Yolo::None | Yolo::Boxes => {}
            Yolo::Segments => {
                return Some(crate::yolo::polygon(class, &crate::yolo::joined(&outlines()), width, height));
            }
            Yolo::Oriented => {
                let corners = outlines().concat();
                let corners = corners.chunks_exact(2).map(|corner| [corner[0] as i64, corner[1] as i64]).collect();
                let corners = smallest_rectangle(&convex_hull(corners), size)?;
                return Some(crate::yolo::polygon(class, &corners, width, height));
            }
        }
        let points = points.iter().find(|points| points.instance == record.id);
        let points = points.iter().flat_map(|points| &points.points).map(|point| (point.x, point.y, point.v));
        let points = points.chain(std::iter::repeat((0.0, 0.0, 0))).take(count);
        let line = crate::yolo::line(class, record.bbox, width, height);
        Some(line + &crate::yolo::keypoints(points, width, height))
    });
    lines.map(|line| line.trim_end().to_owned() + "\n").collect()
}

/// A value as a file of JSON.
pub(crate) fn json(value: &impl Serialize) -> Vec<u8> {
    let mut bytes = serde_json::to_vec(value).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}
