//! Profiles of a mean image along its rows and columns (EMVA 1288 release 4.0 Linear, section 8.2).

use serde::Serialize;

use crate::stack::SpatialStack;

/// A profile along one direction, over all lines: one entry for each pixel of a line \[DN\].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Profile {
    /// The line in the middle.
    pub middle: Vec<f64>,
    /// Mean over the lines.
    pub mean: Vec<f64>,
    /// Smallest of the lines.
    pub least: Vec<f64>,
    /// Largest of the lines.
    pub most: Vec<f64>,
}

/// The profiles along the rows and along the columns.
pub(crate) fn profiles(stack: &SpatialStack) -> [Profile; 2] {
    let (width, height) = (stack.width as usize, stack.height as usize);
    let empty = |n: usize| Profile {
        middle: vec![0.0; n],
        mean: vec![0.0; n],
        least: vec![f64::INFINITY; n],
        most: vec![f64::NEG_INFINITY; n],
    };
    let (mut along_rows, mut along_columns) = (empty(width), empty(height));
    for (i, v) in stack.means().enumerate() {
        let (x, y) = (i % width, i / width);
        for (profile, at, across, lines) in [(&mut along_rows, x, y, height), (&mut along_columns, y, x, width)] {
            profile.mean[at] += v / lines as f64;
            profile.least[at] = profile.least[at].min(v);
            profile.most[at] = profile.most[at].max(v);
            if across == lines / 2 {
                profile.middle[at] = v;
            }
        }
    }
    [along_rows, along_columns]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::stack::StackAccumulator;

    #[test]
    fn profiles_by_hand() {
        let values = [1u16, 2, 3, 40, 50, 60, 7, 8, 9];
        let mut stack = StackAccumulator::new(3, 3);
        for _ in 0..2 {
            stack.add(Frame::new(3, 3, &values).expect("nine")).expect("same size");
        }
        let [rows, columns] = profiles(&stack.finish().expect("frames"));
        assert_eq!(rows.middle, [40.0, 50.0, 60.0]);
        assert_eq!((rows.least[2], rows.most[2]), (3.0, 60.0));
        assert!((rows.mean[1] - 20.0).abs() < 1e-12);
        assert_eq!(columns.middle, [2.0, 50.0, 8.0]);
        assert_eq!(columns.mean[2], 8.0);
    }
}
