//! The drift watch: a control chart for each scanner against the first, with its verdicts.

use super::axis::Axis;
use super::chart::Plot;
use super::figures::{FULL, HALF, series};
use super::html::{self, escape};
use crate::drift::{Alarm, COMPONENTS, Chart, ChartDay, ScannerChart};
use crate::format::day_number;
use crate::judgement;
use crate::number;

const HEIGHT: f64 = 240.0;
/// Half width of the bands, standard deviations.
const BAND: f64 = 2.0;
/// Width of a date below an axis.
const DATE: f64 = 96.0;

/// Positions or rotations: their indices among the components, label, and factor to their unit.
struct Kind {
    first: usize,
    label: &'static str,
    factor: f64,
}

const KINDS: [Kind; 2] = [
    Kind {
        first: 0,
        label: "position (mm)",
        factor: 1e3,
    },
    Kind {
        first: 3,
        label: "rotation (°)",
        factor: 180.0 / std::f64::consts::PI,
    },
];

/// The section of the page: the verdicts on the chart, and its figures.
pub fn section(chart: &Chart) -> String {
    let mut body = html::verdicts(&judgement::drift(chart));
    for scanner in &chart.scanners {
        body.push_str(&format!(
            "<h3>Scanner {} against {}</h3>\n{}{}",
            escape(&scanner.name),
            escape(&chart.first),
            t_squares(chart, scanner),
            components(chart, scanner),
        ));
    }
    let note = "<p class=\"note\">From ground that both scanners saw in one pass. What both do together, such as a \
                rig that is knocked as a whole, does not show here.</p>\n";
    html::section("drift", "Drift watch", &(body + note))
}

/// Days since 1970 of each date.
fn numbers(scanner: &ScannerChart) -> Vec<f64> {
    let days = scanner.days.iter();
    days.map(|day| day_number(&day.date).map_or(f64::NAN, |day| day as f64))
        .collect()
}

/// A chart over dates, with as many date labels as there is room for.
fn over_dates(width: f64, scanner: &ScannerChart, y: Axis) -> Plot {
    let numbers = numbers(scanner);
    let mut x = Axis::over("date", numbers.iter().copied());
    x.min -= 0.5;
    x.max += 0.5;
    let mut plot = Plot::bare(width, HEIGHT, x, y);
    let room = plot.px(plot.x.max) - plot.px(plot.x.min);
    let every = (scanner.days.len() as f64 * DATE / room).ceil().max(1.0) as usize;
    let mut last = f64::NEG_INFINITY;
    let bottom = plot.bottom();
    for (day, number) in scanner.days.iter().zip(numbers).step_by(every) {
        let at = plot.px(number);
        if at - last < DATE {
            continue;
        }
        last = at;
        plot.upright("grid", number);
        // A date at the edge stays within the chart.
        let middle = at.min(width - 0.4 * DATE);
        plot.text("tick", middle, bottom + 17.0, &day.date);
    }
    plot.x_label();
    for (day, number) in scanner.days.iter().zip(self::numbers(scanner)) {
        if day.is_out {
            plot.shade("silent", number - 0.5, number + 0.5);
        }
    }
    plot
}

fn t_squares(chart: &Chart, scanner: &ScannerChart) -> String {
    let points = |value: fn(&ChartDay) -> Option<f64>| -> Vec<[f64; 2]> {
        let all = numbers(scanner).into_iter().zip(&scanner.days);
        all.map(|(number, day)| [number, value(day).unwrap_or(f64::NAN)])
            .collect()
    };
    let (statistics, limits) = (points(|day| day.t2), points(|day| day.limit));
    if statistics.iter().all(|[_, t2]| t2.is_nan()) {
        return String::new();
    }
    let values = statistics.iter().chain(&limits).map(|[_, value]| *value);
    let mut plot = over_dates(FULL, scanner, Axis::logarithmic("T²", values));
    plot.line("s1 dashed", &limits);
    plot.line("s0 fine", &statistics);
    plot.dots("dot s0", 3.6, &statistics);
    let entries = [
        ("s0".to_owned(), "T² of the day".to_owned()),
        ("s1".into(), "limit (dashed)".into()),
        ("silent".into(), "out of limits".into()),
    ];
    let first: Option<&Alarm> = scanner.alarms.first();
    html::figure(
        &(html::legend(&entries) + &plot.finish("T² of each day with its limit")),
        &format!(
            "How far each day lies from the state before, T² = dᵀ S⁻¹ d, with the limit that a campaign without drift \
             exceeds by chance on any of its days with a probability of {}. Held against {}; after an alarm, against \
             the days from it on. What mountings do from day to day counts as no drift: {} mm and {}° (one sigma).{}",
            number::with_unit(
                number::shortest(100.0 * chart.settings.false_alarm_rate),
                "%"
            ),
            if chart.from_calibration {
                "the calibration".to_owned()
            } else {
                format!("the mean of the first {} days", chart.settings.base_days)
            },
            number::shortest(1e3 * chart.settings.day_sigma_m),
            number::significant(chart.settings.day_sigma_rad.to_degrees(), 2),
            first.map_or(String::new(), |alarm| format!(
                " First out of limits: {}.",
                alarm.date
            )),
        ),
    )
}

fn components(chart: &Chart, scanner: &ScannerChart) -> String {
    let charts = KINDS
        .iter()
        .map(|kind| format!("<div>{}</div>", over(kind, scanner)));
    let charts: String = charts.collect();
    html::figure(
        &format!("<div class=\"pair\">{charts}</div>\n"),
        &format!(
            "Where the scanner sits in the frame of {}, along and about its axes, less {}; bands of ± 2 standard \
             deviations. Components that the ground of a day does not determine are missing.",
            escape(&chart.first),
            if chart.from_calibration {
                "the calibration"
            } else {
                "the project's mounting on the first day"
            },
        ),
    )
}

fn over(kind: &Kind, scanner: &ScannerChart) -> String {
    let numbers = numbers(scanner);
    let component = |i: usize| -> Vec<[f64; 3]> {
        let days = numbers.iter().zip(&scanner.days);
        let band = days.map(|(number, day)| {
            let [value, sigma] = [day.offset[i], day.sigma[i]].map(|x| x.unwrap_or(f64::NAN));
            [*number, value * kind.factor, BAND * sigma * kind.factor]
        });
        band.collect()
    };
    let all: Vec<Vec<[f64; 3]>> = (0..3).map(|i| component(kind.first + i)).collect();
    let ends = all.iter().flatten().flat_map(|[_, v, s]| [v - s, v + s]);
    let mut plot = over_dates(HALF, scanner, Axis::rounded(kind.label, ends.chain([0.0])));
    let (from, to) = (plot.x.min, plot.x.max);
    plot.line("zero", &[[from, 0.0], [to, 0.0]]);
    let mut entries = Vec::new();
    for (i, days) in all.iter().enumerate() {
        let band: Vec<[f64; 3]> = days.iter().map(|[x, v, s]| [*x, v - s, v + s]).collect();
        let line: Vec<[f64; 2]> = days.iter().map(|[x, v, _]| [*x, *v]).collect();
        plot.band("band", &band);
        plot.line(&format!("{} fine", series(i)), &line);
        plot.dots(&format!("dot {}", series(i)), 2.6, &line);
        entries.push((series(i), COMPONENTS[kind.first + i].to_owned()));
    }
    entries.push(("band".into(), "± 2 sigma".into()));
    html::legend(&entries) + &plot.finish(kind.label)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drift::{ChartSettings, Overlap};

    /// A knock of 2 mm along x on the seventh of nine days, z open.
    fn chart() -> Chart {
        let day = |number: i32| {
            let x = if number < 7 { 0.0 } else { 2e-3 } + 1e-5 * f64::from(number % 3);
            let identity = |factor: f64| -> Vec<f64> {
                (0..36)
                    .map(|i| if i % 7 == 0 { factor } else { 0.0 })
                    .collect()
            };
            let overlap: Overlap = serde_json::from_value(serde_json::json!({
                "first": "left",
                "scanners": [{
                    "name": "right <2>",
                    "in_use": {"translation_m": [0, 1, 0], "quaternion_xyzw": [0, 0, 0, 1]},
                    "offset": [x, 0, 0, 0, 0, 0],
                    "covariance": identity(1e-8),
                    "determined": [true, true, false, true, true, true],
                    "blocks": 40, "spots": 100, "lag_s": 0.1,
                    "normal": identity(0.3), "vertical": identity(0.3), "total": identity(1.0),
                }]
            }))
            .unwrap();
            (format!("2025-05-{number:02}"), overlap)
        };
        let days: Vec<_> = (1..10).map(day).collect();
        let settings = ChartSettings {
            day_sigma_m: 0.0,
            day_sigma_rad: 0.0,
            ..ChartSettings::default()
        };
        Chart::new(&days, &[], &settings).unwrap()
    }

    #[test]
    fn a_knock_is_told_with_its_dates_and_millimetres() {
        let verdicts = judgement::drift(&chart());
        let codes: Vec<&str> = verdicts.iter().map(|v| v.code.as_str()).collect();
        assert_eq!(codes, ["drift.left", "drift.off", "drift.undetermined"]);
        let text = &verdicts[0].text;
        assert!(text.contains("between 2025-05-06 and 2025-05-07"), "{text}");
        assert!(text.contains("+2.00 ± 0.112 mm x"), "{text}");
        assert!(
            text.contains("move by 2.00 ± 0.11 mm (root mean square), 1.09"),
            "{text}"
        );
        assert!(
            verdicts[1].text.starts_with("Since 2025-05-07 "),
            "{}",
            verdicts[1].text
        );
        assert!(
            verdicts[2].text.contains("did not show z of"),
            "{}",
            verdicts[2].text
        );
    }

    #[test]
    fn figures_have_dates_and_ticks_and_no_gaps_in_paths() {
        let page = section(&chart());
        assert_eq!(page.matches("<svg").count(), 3);
        assert!(page.contains(">2025-05-01</text>") && page.contains("right &lt;2&gt;"));
        for svg in page.split("<svg").skip(1) {
            let svg = svg.split("</svg>").next().unwrap();
            assert!(
                !svg.contains("NaN") && svg.matches("class=\"tick\"").count() >= 6,
                "{svg}"
            );
            assert_eq!(svg.matches("rect class=\"silent\"").count(), 1);
        }
    }
}
