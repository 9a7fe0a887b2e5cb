//! The drift watch: scanners that left their limits, and scanners that stayed within them.

use crate::drift::{COMPONENTS, Chart, ChartDay, Cost, Off, ScannerChart};
use crate::number;
use crate::verdict::Verdict;

/// The verdicts on a chart, one scanner at a time.
pub fn verdicts(chart: &Chart) -> Vec<Verdict> {
    let scanners = chart.scanners.iter();
    scanners
        .flat_map(|scanner| of_scanner(chart, scanner))
        .collect()
}

fn of_scanner(chart: &Chart, scanner: &ScannerChart) -> Vec<Verdict> {
    let pair = format!("{} against {}", scanner.name, chart.first);
    let mut all = Vec::new();
    for alarm in &scanner.alarms {
        let after = match &alarm.last_within {
            Some(date) => format!("between {date} and {}", alarm.date),
            None => format!("before {}", alarm.date),
        };
        let text = format!(
            "Scanner {pair} left its limits {after} (T² {} where {} is the limit): it moved by {}. {}",
            number::significant(alarm.t2, 3),
            number::significant(alarm.limit, 3),
            moved(&alarm.change, &alarm.sigma),
            costs(&scanner.name, &alarm.cost),
        );
        let cost = &alarm.cost;
        all.push(
            Verdict::care("drift.left", text).with_value(cost.total_m, Some(cost.total_sigma_m)),
        );
    }
    if let Some(off) = &scanner.off {
        all.push(is_off(chart, scanner, off));
    }
    let judged = scanner.days.iter().filter(|day| day.t2.is_some()).count();
    if scanner.alarms.is_empty() && judged > 0 {
        let text = format!(
            "Scanner {pair} stayed within its limits on all {judged} days that could be judged."
        );
        all.push(Verdict::good("drift.steady", text));
    }
    if judged == 0 {
        let text = format!(
            "Scanner {pair} could not be judged: there is no day to hold another against, or \
             the ground shows nothing of it."
        );
        all.push(Verdict::note("drift.undetermined", text));
    } else if let Some(names) = undetermined(&scanner.days) {
        let text = format!(
            "The ground did not show {names} of scanner {pair} on every day: these are left out of T² there."
        );
        all.push(Verdict::note("drift.undetermined", text));
    }
    all
}

fn is_off(chart: &Chart, scanner: &ScannerChart, off: &Off) -> Verdict {
    let base = if chart.from_calibration {
        "the calibration"
    } else {
        "the first days"
    };
    let text = format!(
        "Since {} scanner {} sits off {base} against {}: by {}. {} Calibrate again.",
        off.since,
        scanner.name,
        chart.first,
        moved(&off.offset, &off.sigma),
        costs(&scanner.name, &off.cost),
    );
    let cost = &off.cost;
    Verdict::fault("drift.off", text).with_value(cost.total_m, Some(cost.total_sigma_m))
}

/// Components that are not determined on some day; `None` without any.
fn undetermined(days: &[ChartDay]) -> Option<String> {
    let open = |i: &usize| days.iter().any(|day| day.offset[*i].is_none());
    let names: Vec<&str> = (0..6).filter(open).map(|i| COMPONENTS[i]).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// Components with standard deviations.
fn moved(offset: &[Option<f64>; 6], sigma: &[Option<f64>; 6]) -> String {
    let parts = (0..6).filter_map(|i| {
        let (factor, decimals, unit) = if i < 3 {
            (1e3, 2, " mm")
        } else {
            (1f64.to_degrees(), 3, "°")
        };
        let (value, sigma) = (offset[i]? * factor, sigma[i]? * factor);
        let value = number::signed(number::fixed(value, decimals));
        let sigma = number::fixed(sigma, decimals + 1);
        Some(format!("{value} ± {sigma}{unit} {}", COMPONENTS[i]))
    });
    parts.collect::<Vec<_>>().join(", ")
}

fn costs(name: &str, cost: &Cost) -> String {
    let with = |value: f64, sigma: f64| {
        let [value, sigma] = [value, sigma].map(|m| number::fixed(1e3 * m, 2));
        format!("{value} ± {sigma} mm")
    };
    format!(
        "Points of {name} on the ground move by {} (root mean square), {} along the normal and {} upwards.",
        with(cost.total_m, cost.total_sigma_m),
        with(cost.normal_m, cost.normal_sigma_m),
        with(cost.vertical_m, cost.vertical_sigma_m),
    )
}
