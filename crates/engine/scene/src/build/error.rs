//! Errors of the compilation of a scene.

/// Reason why a scene cannot be built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// An index is out of range.
    #[error("{place} refers to {what} {index}, but there are only {count}")]
    BadIndex {
        /// Object that contains the index.
        place: String,
        /// Kind of the object that the index refers to.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of objects of that kind.
        count: usize,
    },
    /// A value is not finite or outside its range.
    #[error("{place}: {problem}")]
    BadValue {
        /// Object that contains the value.
        place: String,
        /// The error and the valid range.
        problem: String,
    },
    /// Every triangle was dropped, and there is no environment that would be visible instead.
    #[error("no triangle is left: {lost}")]
    NothingLeft {
        /// The dropped triangles, their objects and the reasons.
        lost: String,
    },
    /// The scene is so large that its light cannot be computed.
    #[error(
        "{place} extends the scene to {radius} from its centre, where squared distances exceed the range of f32; check for a stray object or a wrong unit"
    )]
    TooLarge {
        /// The object that reaches farthest.
        place: String,
        /// Radius of the scene, with its unit.
        radius: String,
    },
    /// A body scatters light so often that a path through it would take too long.
    #[error("{place}: {problem}; {help}")]
    TooDense {
        /// The object and its material.
        place: String,
        /// The number of scatterings, and the largest one.
        problem: String,
        /// The ways to a medium within the limit.
        help: &'static str,
    },
    /// The hierarchy could not be built.
    #[error("the bounding volume hierarchy cannot be built: {0}")]
    Hierarchy(String),
}
