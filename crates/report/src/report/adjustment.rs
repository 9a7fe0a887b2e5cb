//! Tables of the trajectory's adjustment: sensors, constants, worst and rejected measurements.

use super::html::{self, escape};
use super::track::{Track, adjusted};
use crate::diagnostics::{
    chi_square_text, constant_text, is_notable, quantity, rejection_counts, sensor_name,
    sensors_shown, worst,
};
use crate::judgement;
use crate::number::{self, DASH};
use crate::trajectory::Solution;

/// Number of measurements in the table of the worst.
const WORST: usize = 20;
/// Maximum number of rejected measurements in the table.
const MAX_LISTED: usize = 1000;

/// Statements about the adjustment of the first drive; empty if its poses came from a file.
pub fn statements(tracks: &[Track]) -> String {
    let first = adjusted(tracks).next();
    first.map_or(String::new(), |(track, solution)| {
        html::verdicts(&judgement::trajectory(solution, track.sigmas.as_ref()))
    })
}

/// All tables of the first drive, and the sensors of the others folded below.
pub fn tables(tracks: &[Track]) -> String {
    let mut adjusted = adjusted(tracks);
    let Some((_, first)) = adjusted.next() else {
        return String::new();
    };
    let others: String = adjusted
        .map(|(track, solution)| of_another_drive(track, solution))
        .collect();
    format!("<h3>Residuals by sensor</h3>\n{}", sensors(first))
        + "<p class=\"note\">Redundancy: number of observations that are checked by the others. Ignored: outside the IMU's span or out of time order. Variance component: square of the factor by which the residuals are larger than expected from their standard deviations. χ²: sum of the squared normalised residuals, with the bounds that hold it in 95 % of drives if the standard deviations are right. On long drives the test rejects even negligible factors: what matters is how far the variance component is from 1.</p>\n"
        + &constants(first)
        + &worst_measurements(first)
        + &rejections(first)
        + &html::details("Residuals by sensor on the other drives", &others)
}

fn of_another_drive(track: &Track, solution: &Solution) -> String {
    format!(
        "<h4>{}</h4>\n{}{}",
        escape(track.name),
        html::verdicts(&judgement::trajectory(solution, track.sigmas.as_ref())),
        sensors(solution)
    )
}

fn sensors(solution: &Solution) -> String {
    let with_ignored = solution.sensors.iter().any(|s| s.ignored > 0);
    let mut body = String::new();
    for sensor in sensors_shown(solution) {
        let [low, high] = sensor.chi_square_bounds_95;
        let checked = sensor.variance_component;
        let chi_square = match checked {
            Some(_) => format!(
                "{}<br/><small class=\"sigma\">{} to {}</small>",
                number::fixed(sensor.chi_square, 0),
                number::fixed(low, 0),
                number::fixed(high, 0)
            ),
            None => DASH.to_owned(),
        };
        let ignored = if with_ignored {
            format!("<td>{}</td>", number::count(sensor.ignored))
        } else {
            String::new()
        };
        let class = if is_notable(sensor) {
            "text out"
        } else {
            "text"
        };
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td>{ignored}<td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{chi_square}</td><td class=\"{class}\">{}</td></tr>\n",
            escape(sensor_name(&sensor.name)),
            number::count(sensor.count),
            number::count(sensor.rejected),
            quantity(sensor.rms_raw, &sensor.unit),
            number::fixed(sensor.rms_normalised, 2),
            number::fixed(sensor.redundancy, 0),
            number::fixed(checked.unwrap_or(f64::NAN), 2),
            escape(&chi_square_text(sensor))
        ));
    }
    let ignored = if with_ignored {
        "<th scope=\"col\">ignored</th>"
    } else {
        ""
    };
    let head = format!(
        "<tr><th scope=\"col\">sensor</th><th scope=\"col\">used</th><th scope=\"col\">rejected</th>{ignored}<th scope=\"col\">RMS</th><th scope=\"col\">RMS<br/><small>σ</small></th><th scope=\"col\">redun-<br/>dancy</th><th scope=\"col\">variance<br/>component</th><th scope=\"col\">χ²<br/><small>bounds</small></th><th scope=\"col\" class=\"text\">residuals are</th></tr>\n"
    );
    html::table("numbers sensors", &head, &body)
}

fn constants(solution: &Solution) -> String {
    if solution.constants.is_empty() {
        return String::new();
    }
    let mut body = String::new();
    for constant in &solution.constants {
        let text = constant_text(constant);
        let cell = match &text.sigma {
            Some(sigma) => format!(
                "<td class=\"result\">{}<span class=\"sigma\">± {sigma}</span></td><td>{}</td><td class=\"text\"></td>",
                text.value, text.start
            ),
            None => format!(
                "<td>{DASH}</td><td>{}</td><td class=\"text out\">not determined by this drive</td>",
                text.start
            ),
        };
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th>{cell}<td class=\"text\">{}</td></tr>\n",
            escape(&constant.name),
            escape(&text.unit)
        ));
    }
    let head = "<tr><th scope=\"col\">constant</th><th scope=\"col\">estimated</th><th scope=\"col\">project</th><th scope=\"col\"></th><th scope=\"col\" class=\"text\">unit</th></tr>\n";
    format!(
        "<h3>Constants estimated with the trajectory</h3>\n{}",
        html::table("numbers constants", head, &body)
    )
}

/// A time as in the log, without digit groups, so that it can be searched for.
fn log_time(time_s: f64) -> String {
    if time_s.is_finite() {
        format!("{time_s:.3}")
    } else {
        DASH.into()
    }
}

fn worst_measurements(solution: &Solution) -> String {
    let list = worst(solution, WORST);
    let Some(first) = list.first() else {
        return String::new();
    };
    let mut body = String::new();
    for m in &list {
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"text\">{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"text\">{}</td></tr>\n",
            escape(&m.sensor),
            m.record,
            log_time(m.time_s),
            escape(&m.component),
            number::signed(quantity(m.residual, &m.unit)),
            number::signed(number::fixed(m.normalised, 1)),
            number::signed(number::fixed(m.test, 1)),
            if m.rejected { "rejected" } else { "" }
        ));
    }
    let head = "<tr><th scope=\"col\">sensor</th><th scope=\"col\">record</th><th scope=\"col\">time<br/><small>s</small></th><th scope=\"col\" class=\"text\">component</th><th scope=\"col\">residual</th><th scope=\"col\">residual<br/><small>σ of the measurement</small></th><th scope=\"col\">test<br/><small>σ of the residual</small></th><th scope=\"col\"></th></tr>\n";
    let summary = format!(
        "The {} worst measurements (largest test value {}, {} record {})",
        list.len(),
        number::fixed(first.test.abs(), 1),
        first.sensor,
        first.record
    );
    let note = "<p class=\"note\">Predicted minus measured. The test of data snooping (Baarda) compares the residual with its own standard deviation: 1 in 1000 exceeds 3.3 by chance.</p>\n";
    html::details(&summary, &(html::table("numbers", head, &body) + note))
}

fn rejections(solution: &Solution) -> String {
    if solution.rejections.is_empty() {
        return String::new();
    }
    let mut body = String::new();
    for group in rejection_counts(solution) {
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td class=\"text\">{}</td><td>{}</td></tr>\n",
            escape(sensor_name(&group.sensor)),
            group.reason,
            number::count(group.count)
        ));
    }
    let head = "<tr><th scope=\"col\">sensor</th><th scope=\"col\" class=\"text\">reason</th><th scope=\"col\">records</th></tr>\n";
    let counts = html::table("numbers", head, &body);
    let mut all = String::new();
    for r in solution.rejections.iter().take(MAX_LISTED) {
        all.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"text\">{}</td><td>{}</td></tr>\n",
            escape(sensor_name(&r.sensor)),
            r.record,
            log_time(r.time_s),
            r.reason,
            number::fixed(r.normalised.unwrap_or(f64::NAN), 1)
        ));
    }
    let head = "<tr><th scope=\"col\">sensor</th><th scope=\"col\">record</th><th scope=\"col\">time<br/><small>s</small></th><th scope=\"col\" class=\"text\">reason</th><th scope=\"col\">residual<br/><small>σ</small></th></tr>\n";
    let mut list = html::table("numbers", head, &all);
    let more = solution.rejections.len().saturating_sub(MAX_LISTED);
    if more > 0 {
        list.push_str(&format!(
            "<p class=\"note\">{} more are listed in the JSON result.</p>\n",
            number::count(more)
        ));
    }
    let summary = format!(
        "All {} rejected measurements",
        number::count(solution.rejections.len())
    );
    format!(
        "<h3>Rejected measurements</h3>\n{counts}{}",
        html::details(&summary, &list)
    )
}
