//! The label file of a data set in the format of COCO.
//!
//! Source: Lin et al. 2014 (Microsoft COCO), with the field names of the cocoapi. The fields `instance`, `name`,
//! `visible_fraction`, `cnr` and `size_mm` are additions, which readers of COCO ignore.

use crate::rle::Rle;
use serde::{Deserialize, Serialize};

/// A whole label file.
///
/// It also reads files with additional fields, which it drops. All numbers are finite: JSON has no other ones, and
/// `serde_json` writes them as `null`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Coco {
    /// The origin of the data set.
    pub(crate) info: Info,
    /// Always empty. Readers of COCO expect the field.
    pub(crate) licenses: [(); 0],
    /// The classes of objects.
    pub(crate) categories: Vec<Category>,
    /// The images.
    pub(crate) images: Vec<Image>,
    /// The labelled objects of all images.
    pub(crate) annotations: Vec<Annotation>,
}

/// The origin of a data set.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Info {
    /// One line about the data set.
    pub(crate) description: String,
    /// The version of the data set.
    pub(crate) version: String,
    /// The program or person that made it.
    pub(crate) contributor: String,
    /// Always empty, as above.
    pub(crate) url: String,
}

/// A class of objects.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Category {
    /// The number of the class, from 1. Many readers use 0 for the background.
    pub(crate) id: u32,
    /// Its name, unique in the file.
    pub(crate) name: String,
    /// The group of classes it belongs to, or empty.
    #[serde(default)]
    pub(crate) supercategory: String,
    /// The names of the keypoints of its objects, in their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) keypoints: Option<Vec<String>>,
    /// Pairs of keypoints that a line joins, as positions in `keypoints` from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) skeleton: Option<Vec<[u32; 2]>>,
}

/// An image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Image {
    /// The number of the image, unique in the file.
    pub(crate) id: u64,
    /// Its path, with `/`, relative to the folder of the label file.
    pub(crate) file_name: String,
    /// Width [px].
    pub(crate) width: u32,
    /// Height [px].
    pub(crate) height: u32,
}

/// A labelled object of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Annotation {
    /// The number of the annotation, unique in the file, from 1. The evaluation of `pycocotools` does not count matches
    /// with an annotation 0.
    pub(crate) id: u64,
    /// The `id` of its image.
    pub(crate) image_id: u64,
    /// The `id` of its category.
    pub(crate) category_id: u32,
    /// Its visible pixels.
    pub(crate) segmentation: Segmentation,
    /// The number of its visible pixels [px].
    pub(crate) area: f64,
    /// The box [x, y, width, height] of its visible pixels [px]. It contains whole pixels, with (0, 0) at the top left
    /// corner of the image.
    pub(crate) bbox: [f64; 4],
    /// 1 for a group of objects with one label. Written files contain only 0, also with run lengths: COCO uses run
    /// lengths for groups, but `pycocotools` decides by this field and reads both kinds of segmentation.
    pub(crate) iscrowd: u8,
    /// The number of the object, the same in all images of the data set.
    pub(crate) instance: u64,
    /// The name of the object in the scene.
    pub(crate) name: String,
    /// The visible pixels divided by the pixels without occluders, 0 to 1.
    pub(crate) visible_fraction: f64,
    /// The contrast-to-noise ratio of the object [1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) cnr: Option<f64>,
    /// The largest extent of the object [mm].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) size_mm: Option<f64>,
    /// x, y [px] and v of each keypoint of the category: three numbers each. v is 0 without a label (x = y = 0), 1 for
    /// a hidden point and 2 for a visible one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) keypoints: Option<Vec<f64>>,
    /// The number of keypoints with v > 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) num_keypoints: Option<u32>,
}

/// The pixels of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Segmentation {
    /// Closed polygons x0, y0, x1, y1, ... [px] without holes, at least three corners each. The mask is their union.
    Polygons(Vec<Vec<f64>>),
    /// Run lengths.
    Rle(CompressedRle),
}

/// A mask as compressed run lengths. The other form of COCO, `counts` as a list of numbers, is an error on reading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CompressedRle {
    /// Height and width [px].
    pub(crate) size: [u32; 2],
    /// The runs as a string.
    pub(crate) counts: String,
}

impl From<&Rle> for CompressedRle {
    fn from(mask: &Rle) -> Self {
        Self { size: mask.size(), counts: mask.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn annotation(segmentation: Segmentation) -> Annotation {
        Annotation {
            id: 1,
            image_id: 2,
            category_id: 3,
            segmentation,
            area: 4.0,
            bbox: [1.0, 0.0, 2.0, 2.0],
            iscrowd: 0,
            instance: 17,
            name: "screw \"M3\"\n".to_owned(),
            visible_fraction: 0.1 + 0.2,
            cnr: None,
            size_mm: None,
            keypoints: None,
            num_keypoints: None,
        }
    }

    #[test]
    fn files_survive_writing_and_reading() {
        let mask = CompressedRle { size: [2, 4], counts: "242".to_owned() };
        let square = vec![vec![1.0, 0.0, 3.0, 0.0, 3.0, 2.0, 1.0, 2.0]];
        let full = Annotation {
            cnr: Some(2.5),
            size_mm: Some(0.03),
            keypoints: Some(vec![1.5, 0.5, 2.0, 0.0, 0.0, 0.0]),
            num_keypoints: Some(1),
            ..annotation(Segmentation::Polygons(square))
        };
        let file = Coco {
            info: Info { description: "a set".to_owned(), ..Info::default() },
            licenses: [],
            categories: vec![
                Category { id: 3, name: "screw".to_owned(), ..Category::default() },
                Category {
                    id: 4,
                    name: "bolt".to_owned(),
                    supercategory: "metal".to_owned(),
                    keypoints: Some(vec!["head".to_owned(), "tip".to_owned()]),
                    skeleton: Some(vec![[1, 2]]),
                },
            ],
            images: vec![Image { id: 2, file_name: "images/000002.png".to_owned(), width: 4, height: 2 }],
            annotations: vec![annotation(Segmentation::Rle(mask)), full],
        };
        let text = serde_json::to_string(&file).unwrap();
        assert_eq!(serde_json::from_str::<Coco>(&text).unwrap(), file);
        assert!(!text.contains("null"));
    }

    #[test]
    fn the_fields_have_the_names_of_coco() {
        let mask = CompressedRle { size: [2, 4], counts: "242".to_owned() };
        let json = serde_json::to_value(annotation(Segmentation::Rle(mask))).unwrap();
        assert_eq!(json["segmentation"], serde_json::json!({"size": [2, 4], "counts": "242"}));
        assert_eq!(json["iscrowd"], 0);
        for absent in ["cnr", "size_mm", "keypoints", "num_keypoints"] {
            assert!(json.get(absent).is_none());
        }
        let empty = serde_json::to_value(Coco::default()).unwrap();
        assert_eq!(empty["licenses"], serde_json::json!([]));
        for present in ["info", "categories", "images", "annotations"] {
            assert!(empty.get(present).is_some());
        }
    }

    #[test]
    fn damaged_files_are_errors() {
        for text in ["", "{}", r#"{"info":{},"licenses":[],"categories":[],"images":[{"id":-1}],"annotations":[]}"#] {
            assert!(serde_json::from_str::<Coco>(text).is_err());
        }
        for text in ["7", "{}", r#"{"size":[2],"counts":"0"}"#, r#"{"size":[2,4],"counts":[2,4,2]}"#, "[[\"a\"]]"] {
            assert!(serde_json::from_str::<Segmentation>(text).is_err());
        }
    }
}
