//! The page of a campaign: quality over time, changes between dates, failures and their reasons.

use std::collections::{BTreeMap, BTreeSet};

use super::axis::Axis;
use super::chart::Plot;
use super::drift;
use super::figures::{FULL, series};
use super::html::{self, escape};
use super::page::document;
use crate::drift::Chart;
use crate::format::{civil_time, day_number};
use crate::judgement;
use crate::number::{self, DASH};
use crate::statistics::median;
use crate::verdict::Headline;

/// Most plots of a table that is not folded.
const FEW_PLOTS: usize = 40;
/// Number of lines of a chart with a colour of their own.
const COLOURS: usize = 6;

/// The content of a campaign's page.
#[derive(Debug, Clone, Default)]
pub struct CampaignPage {
    /// Heading.
    pub title: String,
    /// When it was made, seconds since 1970.
    pub made_s: Option<f64>,
    /// Drives that are finished.
    pub drives: Vec<DriveLine>,
    /// Changes that are finished.
    pub changes: Vec<ChangeLine>,
    /// Items that failed.
    pub failures: Vec<FailureLine>,
    /// Number of items that were not tried yet.
    pub waiting: usize,
    /// The drift watch, if it was asked for.
    pub drift: Option<Chart>,
    /// The index of the tiles, relative to the page, if it was written.
    pub index: Option<String>,
}

/// A drive that is finished.
#[derive(Debug, Clone)]
pub struct DriveLine {
    /// The plot.
    pub plot: String,
    /// YYYY-MM-DD.
    pub date: String,
    /// Its page, relative to that of the campaign.
    pub page: String,
    /// Number of its points.
    pub points: u64,
    /// Headline of the drive as a whole.
    pub headline: Headline,
    /// Texts of the verdicts that need attention.
    pub marked: Vec<String>,
    /// Names of clouds that were compared and the root mean square of their distances, metres.
    pub agreement: Vec<(String, f64)>,
}

/// A change that is finished.
#[derive(Debug, Clone)]
pub struct ChangeLine {
    /// The plot.
    pub plot: String,
    /// The earlier date.
    pub before: String,
    /// The later one.
    pub date: String,
    /// Its page, relative to that of the campaign.
    pub page: String,
    /// Mean of the distances, metres.
    pub mean_m: f64,
    /// Median, metres.
    pub median_m: f64,
    /// Share beyond the level of detection.
    pub significant_share: f64,
}

/// An item that failed.
#[derive(Debug, Clone)]
pub struct FailureLine {
    /// `drive p1 2025-05-01`
    pub item: String,
    /// The problem.
    pub problem: String,
    /// The remedy, if there is one.
    pub remedy: Option<String>,
}

/// Renders the page.
pub fn render(page: &CampaignPage) -> String {
    let title = escape(&page.title);
    let made = page.made_s.map_or_else(String::new, |made_s| {
        format!("<span><b>{} UTC</b></span> ", civil_time(made_s))
    });
    let header = format!(
        "<h1>{title}</h1>\n<p class=\"provenance\">{made}<span>by <b>boresight {}</b></span></p>\n",
        env!("CARGO_PKG_VERSION")
    );
    let sections = [
        ("failed", "What failed, and why", failures(&page.failures)),
        ("quality", "Quality over time", quality(&page.drives)),
        (
            "change",
            "What changed from date to date",
            changes(&page.changes),
        ),
        ("care", "What to take care of", care(&page.drives)),
        ("plots", "Plots and dates", plots(page)),
    ];
    let body = sections.iter().filter(|(_, _, body)| !body.is_empty());
    let body: String = body
        .map(|(id, heading, body)| html::section(id, heading, body))
        .collect();
    let drift = page.drift.as_ref().map(drift::section);
    let body = summary(page) + &drift.unwrap_or_default() + &body;
    document(&title, &header, &body)
}

/// The progress of the campaign in one line.
fn summary(page: &CampaignPage) -> String {
    let distinct = |pick: &dyn Fn(&DriveLine) -> String| {
        page.drives.iter().map(pick).collect::<BTreeSet<_>>().len()
    };
    let (plots, dates) = (distinct(&|d| d.plot.clone()), distinct(&|d| d.date.clone()));
    let points: u64 = page.drives.iter().map(|drive| drive.points).sum();
    let count_of = |headline| {
        page.drives
            .iter()
            .filter(|d| d.headline == headline)
            .count()
    };
    let unusable = count_of(Headline::Unusable);
    let drifted = page.drift.iter().flat_map(judgement::drift);
    let drifted = drifted
        .filter(|verdict| verdict.severity.is_marked())
        .count();
    let attention = count_of(Headline::Care) + page.failures.len() + drifted;
    let class = match (unusable, attention) {
        (0, 0) => "good",
        (0, _) => "attention",
        _ => "fault",
    };
    let mut marked = String::new();
    for (number, word) in [
        (count_of(Headline::Care), "to take care of"),
        (unusable, "not usable"),
    ] {
        if number > 0 {
            marked += &format!(", {} {word}", number::count(number));
        }
    }
    let mut items = match page.failures.len() {
        0 => "no item failed".to_owned(),
        failed => format!("{} failed", count(failed, "item")),
    };
    if page.waiting > 0 {
        items += &format!(", {} not done yet", number::count(page.waiting));
    }
    let index = page.index.as_ref().map_or_else(String::new, |index| {
        format!(
            " The tiles and where they are: <a href=\"{0}\">{0}</a> (GeoParquet).",
            escape(index)
        )
    });
    format!(
        "<p class=\"headline {class}\">{} of {} on {}{marked}; {items}.</p>\n<p>{} points.{index}</p>\n",
        count(page.drives.len(), "drive"),
        count(plots, "plot"),
        count(dates, "date"),
        number::count(points as usize),
    )
}

fn count(n: usize, what: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{} {what}{s}", number::count(n))
}

fn failures(all: &[FailureLine]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let row = |line: &FailureLine| {
        format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td></tr>\n",
            escape(&line.item),
            escape(&line.problem),
            escape(line.remedy.as_deref().unwrap_or(DASH))
        )
    };
    let rows: String = all.iter().map(row).collect();
    html::table(
        "numbers words",
        &html::head(&["item", "problem", "remedy"]),
        &rows,
    )
}

/// Days since 1970 of a date.
fn day(date: &str) -> f64 {
    day_number(date).map_or(f64::NAN, |day| day as f64)
}

/// A value of a plot on a date.
type Value<'a> = (&'a str, &'a str, f64);

/// Values over days: a dot for each plot, a line through the medians.
fn over_time(label: &str, series_of: &[(String, Vec<Value<'_>>)]) -> String {
    let all = || series_of.iter().flat_map(|(_, values)| values);
    let Some(first) = all().map(|(_, date, _)| *date).min() else {
        return String::new();
    };
    let start = day(first);
    let x = Axis::over(
        &format!("days since {first}"),
        all().map(|(_, date, _)| day(date) - start),
    );
    let y = Axis::rounded(label, all().map(|(_, _, value)| *value).chain([0.0]));
    let mut plot = Plot::new(FULL, 300.0, x.clone(), y);
    plot.line("zero", &[[x.min, 0.0], [x.max, 0.0]]);
    let mut entries = Vec::new();
    for (i, (name, values)) in series_of.iter().enumerate() {
        let class = series(i % COLOURS);
        let dots: Vec<[f64; 2]> = values
            .iter()
            .map(|(_, date, value)| [day(date) - start, *value])
            .collect();
        plot.scatter(&class, &dots);
        let mut by_day: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (_, date, value) in values {
            by_day.entry(date).or_default().push(*value);
        }
        let line: Vec<[f64; 2]> = by_day
            .into_iter()
            .filter_map(|(date, values)| Some([day(date) - start, median(values)?]))
            .collect();
        plot.line(&class, &line);
        entries.push((class, name.clone()));
    }
    html::legend(&entries) + &plot.finish(label)
}

fn quality(drives: &[DriveLine]) -> String {
    let mut pairs: BTreeMap<&str, Vec<Value<'_>>> = BTreeMap::new();
    for drive in drives {
        for (pair, rmse_m) in &drive.agreement {
            pairs
                .entry(pair)
                .or_default()
                .push((&drive.plot, &drive.date, 1e3 * rmse_m));
        }
    }
    if pairs.is_empty() {
        return String::new();
    }
    let rows: String = pairs
        .iter()
        .map(|(pair, values)| {
            let sizes = values.iter().map(|value| value.2);
            let worst = values.iter().max_by(|a, b| a.2.total_cmp(&b.2));
            let worst = worst.map_or_else(String::new, |(plot, date, value)| {
                format!(
                    "{} ({} {})",
                    number::fixed(*value, 2),
                    escape(plot),
                    escape(date)
                )
            });
            format!(
                "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{worst}</td></tr>\n",
                escape(pair),
                number::count(values.len()),
                median(sizes).map_or(DASH.to_owned(), |size| number::fixed(size, 2))
            )
        })
        .collect();
    let head = html::head(&["clouds", "drives", "median RMSE (mm)", "largest (mm)"]);
    let owned: Vec<(String, Vec<Value<'_>>)> = pairs
        .into_iter()
        .map(|(pair, values)| (pair.to_owned(), values))
        .collect();
    html::table("numbers", &head, &rows)
        + &html::figure(
            &over_time("M3C2 RMSE (mm)", &owned),
            "Distances between the clouds of each drive: a dot is a plot, the line goes through the medians of a date.",
        )
}

fn changes(all: &[ChangeLine]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let values: Vec<Value<'_>> = all
        .iter()
        .map(|line| (line.plot.as_str(), line.date.as_str(), 1e3 * line.median_m))
        .collect();
    let figure = html::figure(
        &over_time(
            "median change (mm)",
            &[("from the date before".to_owned(), values)],
        ),
        "Distance of each plot from its date before, along the normal and upwards positive: a dot is a plot, the line goes through the medians of a date.",
    );
    let row = |line: &ChangeLine| {
        let share = if line.significant_share.is_nan() {
            DASH.to_owned()
        } else {
            number::fixed(100.0 * line.significant_share, 0) + " %"
        };
        format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td><a href=\"{}\">{}</a></td><td>{}</td><td>{}</td><td>{share}</td></tr>\n",
            escape(&line.plot),
            escape(&line.before),
            escape(&line.page),
            escape(&line.date),
            number::fixed(1e3 * line.mean_m, 2),
            number::fixed(1e3 * line.median_m, 2),
        )
    };
    let rows: String = all.iter().map(row).collect();
    let head = html::head(&[
        "plot",
        "from",
        "to",
        "mean (mm)",
        "median (mm)",
        "beyond the level of detection",
    ]);
    figure + &html::details("Every plot and date", &html::table("numbers", &head, &rows))
}

/// A table of plots by dates; every cell links to the page of the drive.
fn plots(page: &CampaignPage) -> String {
    let dates: BTreeSet<&str> = page
        .drives
        .iter()
        .map(|drive| drive.date.as_str())
        .collect();
    let mut rows: BTreeMap<&str, BTreeMap<&str, &DriveLine>> = BTreeMap::new();
    for drive in &page.drives {
        rows.entry(&drive.plot)
            .or_default()
            .insert(&drive.date, drive);
    }
    if rows.is_empty() {
        return String::new();
    }
    let cell = |drive: Option<&&DriveLine>| match drive {
        None => format!("<td>{DASH}</td>"),
        Some(drive) => {
            let (sign, word) = match drive.headline {
                Headline::Usable => ("✓", "usable"),
                Headline::Care => ("!", "take care"),
                Headline::Unusable => ("✗", "not usable"),
            };
            let text = format!("{} {}: {word}", escape(&drive.plot), escape(&drive.date));
            format!(
                "<td><a href=\"{}\" aria-label=\"{text}\" title=\"{text}\">{sign}</a></td>",
                escape(&drive.page)
            )
        }
    };
    let body: String = rows
        .iter()
        .map(|(plot, drives)| {
            let cells: String = dates.iter().map(|date| cell(drives.get(date))).collect();
            format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escape(plot))
        })
        .collect();
    let mut heads = vec!["plot"];
    heads.extend(&dates);
    let table = html::table("numbers", &html::head(&heads), &body);
    let note = "<p class=\"note\">✓ usable, ! take care, ✗ not usable, – none or failed. Each leads to the page of the drive.</p>\n";
    if rows.len() <= FEW_PLOTS {
        table + note
    } else {
        html::details(&count(rows.len(), "plot"), &(table + note))
    }
}

/// The verdicts on drives, each statement once with the number of drives.
fn care(drives: &[DriveLine]) -> String {
    let mut statements: Vec<(&str, Vec<String>)> = Vec::new();
    for drive in drives {
        for text in &drive.marked {
            let name = format!("{} {}", drive.plot, drive.date);
            match statements.iter_mut().find(|(other, _)| other == text) {
                Some((_, names)) => names.push(name),
                None => statements.push((text, vec![name])),
            }
        }
    }
    if statements.is_empty() {
        return String::new();
    }
    statements.sort_by_key(|(_, names)| std::cmp::Reverse(names.len()));
    let row = |(text, names): &(&str, Vec<String>)| {
        let more = match names.len() {
            1 => String::new(),
            n => format!(" and {} more", n - 1),
        };
        format!(
            "<tr><th scope=\"row\">{}{more}</th><td>{}</td></tr>\n",
            escape(&names[0]),
            escape(text)
        )
    };
    let rows: String = statements.iter().map(row).collect();
    let table = html::table(
        "numbers words",
        &html::head(&["drive", "what is said"]),
        &rows,
    );
    if statements.len() <= FEW_PLOTS {
        table
    } else {
        html::details(&count(statements.len(), "statement"), &table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_names_what_failed_and_links_what_did_not() {
        let drive = |plot: &str, date: &str, rmse_m: f64| DriveLine {
            plot: plot.into(),
            date: date.into(),
            page: format!("items/{plot}/drive.html"),
            points: 1000,
            headline: Headline::Usable,
            marked: vec!["poses are <uncertain>".into()],
            agreement: vec![("left to reference".into(), rmse_m)],
        };
        let page = CampaignPage {
            title: "Beet".into(),
            drives: vec![
                drive("p", "2025-05-01", 1e-3),
                drive("q", "2025-05-08", 3e-3),
            ],
            failures: vec![FailureLine {
                item: "drive r 2025-05-01".into(),
                problem: "left.bin, byte 7: found an end".into(),
                remedy: None,
            }],
            ..CampaignPage::default()
        };
        let text = render(&page);
        for part in [
            "2 drives of 2 plots on 2 dates; 1 item failed",
            "left.bin, byte 7",
            "items/q/drive.html",
            "3.00 (q 2025-05-08)",
            "p 2025-05-01 and 1 more",
            "poses are &lt;uncertain&gt;",
            "days since 2025-05-01",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
        assert!(!text.contains("id=\"change\""));
    }
}
