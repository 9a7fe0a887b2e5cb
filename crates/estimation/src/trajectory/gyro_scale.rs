//! The scale factor of the gyroscope: the rate that it reads over the true one.

use crate::adjustment::Parameter;
use crate::geometry::Vec3;
use crate::sensor::ImuBias;

/// The factors k of the body's axes. Samples ω are divided by the factors k₀ of an earlier adjustment; the rest acts in each
/// step as a change of the bias, of the size that the mean rate ω̄ of the step gives it:
/// ω_true = ω k₀/k − b ≈ ω − (b + (1 − k₀/k) ω̄). The samples are divided again until k₀ hardly differs from k, so that
/// the approximation hardly matters.
#[derive(Debug, Clone)]
pub struct GyroScale {
    /// k, 1 without an error of scale.
    pub factor: Parameter<Vec3>,
    /// k₀.
    divided_by: Vec3,
}

impl GyroScale {
    /// No error of scale.
    pub fn none() -> Self {
        Self {
            factor: Parameter::held(Vec3::repeat(1.0)),
            divided_by: Vec3::repeat(1.0),
        }
    }

    /// Takes over the factors of an earlier adjustment, by which the samples are divided.
    pub fn resume(&mut self, before: &Self) {
        self.factor.value = before.factor.value;
        self.divided_by = before.factor.value;
    }

    /// The largest share of a rate that the samples are still off by.
    pub fn left(&self) -> f64 {
        self.share().amax()
    }

    /// 1 − k₀/k.
    fn share(&self) -> Vec3 {
        Vec3::repeat(1.0) - self.divided_by.component_div(&self.factor.value)
    }

    /// The bias that acts at a mean rate: b + (1 − k₀/k) ω̄.
    pub fn bias_at(&self, mean_rate_rad_s: impl FnOnce() -> Vec3, bias: &ImuBias) -> ImuBias {
        if self.divided_by == self.factor.value {
            return *bias;
        }
        let by_scale = self.share().component_mul(&mean_rate_rad_s());
        ImuBias {
            gyro_rad_s: bias.gyro_rad_s + by_scale,
            ..*bias
        }
    }

    /// The derivative of [`Self::bias_at`] by k, k₀/k² ω̄.
    pub fn by_factor(&self, mean_rate_rad_s: &Vec3) -> Vec3 {
        let k = &self.factor.value;
        let share = self.divided_by.component_div(&k.component_mul(k));
        share.component_mul(mean_rate_rad_s)
    }
}
