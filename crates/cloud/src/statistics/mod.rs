//! Statistics of samples, and quantiles of the normal, χ², F and Student's t distributions.

mod draws;
mod even;
mod fisher;
mod normal;
mod sample;
mod series;
mod student;

pub use draws::{drawn, drawn_sign};
pub use even::EvenSample;
pub use fisher::fisher_exceeded;
pub use normal::{
    CHI_SQUARE_1_MEDIAN, NORMAL_97_5, NORMAL_97_5_ROUNDED, SIGMAS_PER_MAD, chi_square,
    chi_square_bounds_95,
};
pub use sample::{correlation, mean, median, quantile, quartile, rms};
pub use series::Series;
pub use student::student_97_5;
