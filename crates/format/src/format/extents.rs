//! Extents of the cloud files that an index lists.

/// A file of an index and the extent of its points.
#[derive(Debug, Clone, PartialEq)]
pub struct Extent {
    /// The plot.
    pub plot: String,
    /// The date, YYYY-MM-DD.
    pub date: String,
    /// The item of the campaign that wrote it.
    pub item: String,
    /// The file, relative to the index.
    pub path: String,
    /// Number of its points.
    pub points: u64,
    /// Lowest coordinates (east, north, up), metres.
    pub low_m: [f64; 3],
    /// Highest coordinates, metres.
    pub high_m: [f64; 3],
}
