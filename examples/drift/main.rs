//! Campaigns of simulated days, on one of which the right scanner is knocked. Compares the results of the drift watch
//! with the truth, day by day.
//!
//! `cargo run --release --features examples --example drift -- 3 1`

mod engines;

#[path = "../../tests/common/field_days.rs"]
mod field_days;

use std::time::Instant;

use boresight::Result;
use boresight::drift::{COMPONENTS, Chart, ChartSettings, Overlap};
use boresight::error::Error;
use field_days::{FieldDay, Knock, date, scenario};

const USAGE: &str =
    "drift [SEEDS] [FIRST] [--days N] [--knocked DAY] [--passes N] [--page FILE] [--engines]";

/// Knocks of 2 mm and 0.1°, for each seed along and about other axes of the body.
const KNOCKS: [Knock; 3] = [
    Knock {
        shift_m: [0.0, 0.0, 0.002],
        turn_deg: [0.1, 0.0, 0.0],
    },
    Knock {
        shift_m: [0.002, 0.0, 0.0],
        turn_deg: [0.0, 0.1, 0.0],
    },
    Knock {
        shift_m: [0.0, 0.002, 0.0],
        turn_deg: [0.0, 0.0, 0.1],
    },
];

struct Options {
    seeds: u64,
    first: u64,
    days: u64,
    /// Day of the knock; 0 for none.
    knocked: u64,
    passes: usize,
    page: Option<String>,
    engines: bool,
}

fn main() -> Result<()> {
    let options = options()?;
    let mut all = Sums::default();
    for seed in options.first..options.first + options.seeds {
        campaign(seed, &options, &mut all)?;
    }
    all.print("all campaigns");
    Ok(())
}

fn campaign(seed: u64, options: &Options, all: &mut Sums) -> Result<()> {
    let knock = &KNOCKS[((seed + 2) % 3) as usize];
    let mut days = Vec::<(String, Overlap)>::new();
    let (mut truths, mut seconds) = (Vec::new(), Vec::new());
    let mut own = Sums::default();
    for day in 1..=options.days {
        let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
        let knock = (options.knocked > 0 && day >= options.knocked).then_some(knock);
        let field = FieldDay::new(scenario(seed, day, options.passes), knock, folder.path())?;
        let begun = Instant::now();
        let found = field.overlap()?;
        seconds.push(begun.elapsed().as_secs_f64());
        let right = &found.scanners[0];
        let sigma = right.covariance.diagonal().map(f64::sqrt);
        for i in 0..6 {
            let error = right.offset[i] - field.truth[i];
            own.add(i, error, sigma[i]);
            all.add(i, error, sigma[i]);
        }
        if options.engines {
            engines::compare(&field, day)?;
        }
        truths.push(field.truth);
        days.push((date(day), found));
    }
    // The simulated mountings do not change from day to day, so the limits are at their tightest.
    let settings = ChartSettings {
        day_sigma_m: 0.0,
        day_sigma_rad: 0.0,
        ..ChartSettings::default()
    };
    let chart = Chart::new(&days, &[], &settings)?;
    if let Some(page) = &options.page {
        let figures = boresight::report::drift::section(&chart);
        std::fs::write(page, figures).map_err(|e| Error::io(page, e))?;
    }
    let right = &chart.scanners[0];
    println!(
        "\ncampaign {seed}, knock on day {} by {knock:?}",
        options.knocked
    );
    println!(
        "error (sigma) in mm along x y z and in 0.001° about them; T² and its limit; spots; seconds"
    );
    for (number, day) in right.days.iter().enumerate() {
        let found = &days[number].1.scanners[0];
        let errors = (0..6).map(|i| {
            let unit = unit(i);
            let error = (found.offset[i] - truths[number][i]) * unit;
            let open = if found.determined[i] { "" } else { "?" };
            format!(
                "{error:+.3} ({:.3}){open}",
                found.covariance[(i, i)].sqrt() * unit
            )
        });
        let text = |value: Option<f64>| value.map_or("–".into(), |value| format!("{value:.1}"));
        println!(
            "{} | {} | {} of {} {} | {} | {:.1}",
            day.date,
            errors.collect::<Vec<_>>().join(" "),
            text(day.t2),
            text(day.limit),
            if day.is_out { "OUT" } else { "" },
            found.spots,
            seconds[number]
        );
    }
    for alarm in &right.alarms {
        println!(
            "left its limits on {} (within them on {}): T² {:.1} of {:.1}; points move by {:.2} ± {:.2} mm, {:.2} ± {:.2} mm \
             along the normal, {:.2} ± {:.2} mm upwards",
            alarm.date,
            alarm.last_within.as_deref().unwrap_or("no day"),
            alarm.t2,
            alarm.limit,
            1e3 * alarm.cost.total_m,
            1e3 * alarm.cost.total_sigma_m,
            1e3 * alarm.cost.normal_m,
            1e3 * alarm.cost.normal_sigma_m,
            1e3 * alarm.cost.vertical_m,
            1e3 * alarm.cost.vertical_sigma_m,
        );
    }
    if let Some(off) = &right.off {
        let mean = |range: std::ops::Range<usize>, i: usize| {
            truths[range.clone()]
                .iter()
                .map(|truth| truth[i])
                .sum::<f64>()
                / range.len() as f64
        };
        println!("off since {}:", off.since);
        let at = options.knocked.saturating_sub(1) as usize;
        for (i, name) in COMPONENTS.iter().enumerate() {
            if let (Some(found), Some(sigma)) = (off.offset[i], off.sigma[i]) {
                let (truth, unit) = (mean(at..truths.len(), i) - mean(0..at.max(1), i), unit(i));
                println!(
                    "  {name}: {:+.3} ± {:.3}, true {:+.3}: {:+.2} sigma",
                    found * unit,
                    sigma * unit,
                    truth * unit,
                    (found - truth) / sigma
                );
            }
        }
    }
    own.print(&format!("campaign {seed}"));
    Ok(())
}

/// Factor of a component to millimetres or thousandths of a degree.
fn unit(component: usize) -> f64 {
    if component < 3 {
        1e3
    } else {
        1e3_f64.to_degrees()
    }
}

/// Statistics of errors and of errors divided by sigma.
#[derive(Default)]
struct Sums {
    /// For each component: number, sums of errors and their squares, sums of ratios and their squares.
    all: [[f64; 5]; 6],
    inside: f64,
}

impl Sums {
    fn add(&mut self, component: usize, error: f64, sigma: f64) {
        let ratio = error / sigma;
        let sums = &mut self.all[component];
        for (sum, value) in sums
            .iter_mut()
            .zip([1.0, error, error * error, ratio, ratio * ratio])
        {
            *sum += value;
        }
        self.inside += f64::from(u8::from(ratio.abs() < 1.96));
    }

    fn print(&self, name: &str) {
        println!(
            "{name}: errors, root mean square and mean; error over sigma, root mean square and mean"
        );
        let mut total = [0.0; 2];
        for (i, [count, sum, squares, ratios, ratio_squares]) in self.all.iter().enumerate() {
            total[0] += count;
            total[1] += ratio_squares;
            println!(
                "  {}: {:.4} {:+.4} | {:.2} {:+.2}",
                COMPONENTS[i],
                (squares / count).sqrt() * unit(i),
                sum / count * unit(i),
                (ratio_squares / count).sqrt(),
                ratios / count
            );
        }
        println!(
            "  all {}: root mean square {:.3}, {:.1} % within 1.96 sigma",
            total[0],
            (total[1] / total[0]).sqrt(),
            100.0 * self.inside / total[0]
        );
    }
}

fn options() -> Result<Options> {
    let mut found = Options {
        seeds: 1,
        first: 1,
        days: 20,
        knocked: 7,
        passes: 2,
        page: None,
        engines: false,
    };
    let wrong = |what: &str| Error::data(format!("{what}: not understood"), USAGE);
    let mut numbers = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| wrong(&argument));
        let number = |text: String| text.parse::<u64>().map_err(|_| wrong(&text));
        match argument.as_str() {
            "--days" => found.days = number(value()?)?,
            "--knocked" => found.knocked = number(value()?)?,
            "--passes" => found.passes = number(value()?)? as usize,
            "--page" => found.page = Some(value()?),
            "--engines" => found.engines = true,
            other => numbers.push(number(other.into())?),
        }
    }
    if let Some(seeds) = numbers.first() {
        found.seeds = *seeds;
    }
    if let Some(first) = numbers.get(1) {
        found.first = *first;
    }
    Ok(found)
}
