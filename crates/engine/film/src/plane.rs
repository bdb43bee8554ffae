//! A rectangle of numbers.

/// `width * height` values, row by row from the top left.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Plane<T> {
    width: u32,
    height: u32,
    data: Vec<T>,
}

impl<T: Clone> Plane<T> {
    /// A plane filled with one value.
    pub fn new(width: u32, height: u32, value: T) -> Self {
        Self { width, height, data: vec![value; width as usize * height as usize] }
    }
}

impl<T> Plane<T> {
    /// A plane from its values; `None` if their number is not `width * height`.
    pub fn from_vec(width: u32, height: u32, data: Vec<T>) -> Option<Self> {
        (data.len() == width as usize * height as usize).then_some(Self { width, height, data })
    }

    /// A plane from one value for each pixel, row by row.
    ///
    /// # Panics
    /// If there are more or fewer values than pixels.
    pub fn of_pixels(width: u32, height: u32, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width as usize * height as usize);
        Self { width, height, data }
    }

    /// A plane with the value of a function at each (x, y).
    pub fn from_fn(width: u32, height: u32, mut f: impl FnMut(u32, u32) -> T) -> Self {
        let mut data = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                data.push(f(x, y));
            }
        }
        Self { width, height, data }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All values, row by row.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// All values, row by row.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The values as a vector.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// The value at (x, y).
    ///
    /// # Panics
    /// If (x, y) is outside the plane.
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> &T {
        assert!(x < self.width && y < self.height, "({x}, {y}) is outside {} x {}", self.width, self.height);
        &self.data[y as usize * self.width as usize + x as usize]
    }

    /// A plane of the same size with `f` applied to each value.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Plane<U> {
        Plane { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}
