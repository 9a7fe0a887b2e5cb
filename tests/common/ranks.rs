//! Ranks of true values in the distributions that results state (simulation-based calibration: Talts et al. 2018,
//! arXiv 1804.06788). If truths are drawn from the stated priors and the stated distributions are right, the ranks are
//! uniform between 0 and 1.
#![allow(dead_code)] // tests and examples use their parts

/// The probability below which ranks count as not uniform.
pub const LEVEL: f64 = 0.01;

/// Ranks of one quantity, one per drive.
pub struct Ranks {
    pub quantity: &'static str,
    pub ranks: Vec<f64>,
}

/// The rank of an error of `sigmas` standard deviations in a normal distribution, between 0 and 1.
pub fn rank(sigmas: f64) -> f64 {
    0.5 * libm::erfc(-sigmas / std::f64::consts::SQRT_2)
}

/// The probability that as many uniform numbers differ as much from a uniform distribution (Kolmogorov's test, with
/// the approximation of Stephens 1970 for few numbers); 1 without any.
pub fn probability(ranks: &[f64]) -> f64 {
    if ranks.is_empty() {
        return 1.0;
    }
    let mut sorted = ranks.to_vec();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len() as f64;
    let distance = (0..).zip(&sorted).fold(0.0, |most: f64, (below, rank)| {
        let [low, high] = [below, below + 1].map(|n| f64::from(n) / count);
        most.max(rank - low).max(high - rank)
    });
    let scaled = distance * (count.sqrt() + 0.12 + 0.11 / count.sqrt());
    // Kolmogorov's series alternates and does not converge at 0, where the probability is 1.
    if scaled < 0.3 {
        return 1.0;
    }
    let term = |k: i32| -(-1f64).powi(k) * (-2.0 * (f64::from(k) * scaled).powi(2)).exp();
    (2.0 * (1..=100).map(term).sum::<f64>()).clamp(0.0, 1.0)
}

/// Histograms of ranks side by side, each with the band in which 99 % of the counts lie if ranks are uniform: an SVG.
pub fn figure(all: &[Ranks]) -> String {
    const BINS: usize = 10;
    const SIDE: f64 = 76.0;
    const HEIGHT: f64 = 110.0;
    // 99.5 % quantile of the standard normal distribution.
    const BEYOND: f64 = 2.576;
    let width = 20.0 + all.len() as f64 * (SIDE + 10.0);
    let panels = (0..).zip(all).map(|(place, of): (u32, _)| {
        let left = 10.0 + f64::from(place) * (SIDE + 10.0);
        let mut counts = [0u32; BINS];
        for rank in &of.ranks {
            counts[((rank * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        let expected = of.ranks.len() as f64 / BINS as f64;
        let spread = BEYOND * (expected * (1.0 - 1.0 / BINS as f64)).sqrt();
        let most = counts.iter().copied().max().unwrap_or(0);
        let scale = HEIGHT / f64::from(most).max(expected + spread).max(1.0);
        let bottom = HEIGHT + 20.0;
        let bar = SIDE / BINS as f64;
        let bars = (0..).zip(counts).map(|(bin, count): (u32, _)| {
            let (x, height) = (left + f64::from(bin) * bar, f64::from(count) * scale);
            let (y, wide) = (bottom - height, bar - 1.0);
            format!("<rect class=\"bar\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{wide:.1}\" height=\"{height:.1}\"/>\n")
        });
        let high = bottom - scale * (expected + spread);
        let tall = scale * (spread + spread.min(expected));
        let (middle, count) = (left + 0.5 * SIDE, of.ranks.len());
        format!(
            "<rect class=\"band\" x=\"{left:.1}\" y=\"{high:.1}\" width=\"{SIDE}\" height=\"{tall:.1}\"/>\n{}\
             <text x=\"{middle:.1}\" y=\"14\">{} ({count})</text>\n",
            bars.collect::<String>(),
            of.quantity,
        )
    });
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} 152\" width=\"{width}\" height=\"152\" \
         role=\"img\" aria-labelledby=\"title\">\n<title id=\"title\">Ranks of the truth in the stated distributions, \
         from 0 to 1, with the band of uniform ranks</title>\n<style>\ntext {{ font: 12px system-ui, sans-serif; fill: \
         #1b1f24; text-anchor: middle }} .back {{ fill: #ffffff }} .band {{ fill: #5b636d; fill-opacity: .25 }} .bar {{ \
         fill: #1d4ed8; fill-opacity: .75 }}\n@media (prefers-color-scheme: dark) {{ text {{ fill: #e4e7ea }} .back {{ \
         fill: #1c2126 }} .band {{ fill: #a3acb6; fill-opacity: .3 }} .bar {{ fill: #7ab8ff }} }}\n</style>\n\
         <rect class=\"back\" width=\"{width}\" height=\"152\" rx=\"8\"/>\n{}</svg>\n",
        panels.collect::<String>(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_and_probabilities_are_those_of_the_tables() {
        assert!((rank(0.0) - 0.5).abs() < 1e-15);
        assert!((rank(1.959_963_985) - 0.975).abs() < 1e-10);
        // Uniform numbers.
        let even: Vec<f64> = (0..100).map(|k| (f64::from(k) + 0.5) / 100.0).collect();
        assert_eq!(probability(&even), 1.0);
        // 1.63 / √n is the limit at 1 % for many numbers: ranks that lie that far below their place.
        let count = 10_000;
        let shifted = |distance: f64| -> Vec<f64> {
            let place = |k: u32| (f64::from(k) + 0.5) / f64::from(count) - distance;
            (0..count).map(|k| place(k).max(0.0)).collect()
        };
        let limit = probability(&shifted(1.628 / f64::from(count).sqrt()));
        assert!((limit - LEVEL).abs() < 1e-3, "{limit}");
        // Standard deviations half as large as they should be.
        let wide: Vec<f64> = (1..100)
            .map(|k| rank(2.0 * quantile(f64::from(k) / 100.0)))
            .collect();
        assert!(probability(&wide) < LEVEL);
    }

    /// The inverse of [`rank`], by bisection.
    fn quantile(probability: f64) -> f64 {
        let (mut low, mut high) = (-10.0, 10.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if rank(middle) < probability {
                &mut low
            } else {
                &mut high
            }) = middle;
        }
        low
    }
}
