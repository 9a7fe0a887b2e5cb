//! The platform as a drawing: body axes, prism and antennas, and the fans of the scanners before and after the
//! calibration.

use super::content::Platform;
use super::html::{self, escape};
use crate::geometry::{BodyAxes, BodyFromScanner, Vec3};
use crate::number;

/// Width and height of the oblique view.
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 330.0;
/// Room around the drawing, for texts.
const MARGIN: f64 = 30.0;
/// Fans that reach further than this many times the size of the platform are cut off at that distance.
const LONGEST: f64 = 2.0;
/// Smallest size of a platform, metres.
const LEAST_M: f64 = 0.5;

/// The mounting of a scanner before and after.
pub struct Fan<'a> {
    /// Name of the scanner.
    pub name: &'a str,
    /// The initial mounting; `None` if it is not known.
    pub before: Option<BodyFromScanner>,
    /// The estimated mounting.
    pub after: BodyFromScanner,
}

/// A direction of view: two rows that map forward, left and up to the right and up directions of the drawing.
struct View {
    right: [f64; 3],
    up: [f64; 3],
}

impl View {
    /// The view from the front right and above, without perspective.
    fn oblique() -> Self {
        let (azimuth, elevation) = (-38f64.to_radians(), 24f64.to_radians());
        let (sin, cos) = azimuth.sin_cos();
        Self {
            right: [-sin, cos, 0.0],
            up: [
                -elevation.sin() * cos,
                -elevation.sin() * sin,
                elevation.cos(),
            ],
        }
    }

    fn of(&self, [forward, left, up]: [f64; 3]) -> [f64; 2] {
        let along = |row: [f64; 3]| row[0] * forward + row[1] * left + row[2] * up;
        [along(self.right), along(self.up)]
    }
}

/// The drawing with its caption; empty without scanners.
pub fn drawing(platform: &Platform, fans: &[Fan]) -> String {
    if fans.is_empty() {
        return String::new();
    }
    let view = View::oblique();
    let level = |p: Vec3| match platform.axes {
        BodyAxes::Frd => [p.x, -p.y, -p.z],
        BodyAxes::Flu => [p.x, p.y, p.z],
    };
    let place = |p: Vec3| view.of(level(p));
    let arms = platform.marks.iter().map(|(_, p)| p.norm());
    let mounts = fans.iter().map(|fan| fan.after.translation_m.norm());
    let size_m = arms.chain(mounts).fold(LEAST_M, f64::max);
    let (fans, is_cut) = cut(platform, fans, LONGEST * size_m);

    let axis_m = 0.35 * size_m;
    let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| axis_m * axis);
    let corners = fans.iter().flat_map(|fan| {
        let (before, after) = (fan.before.as_deref().unwrap_or_default(), &fan.after);
        before.iter().chain(after).copied()
    });
    let marks = platform.marks.iter().map(|(_, p)| *p);
    let all = corners.chain(marks).chain(axes).chain([Vec3::zeros()]);
    let sheet = Sheet::around(all.map(&place));
    let at = |p: Vec3| sheet.at(place(p));

    let mut body = String::new();
    for (fan, class) in fans.iter().zip(classes()) {
        if let Some(before) = &fan.before {
            body.push_str(&polygon("fan before", before, &at));
        }
        body.push_str(&polygon(&format!("fan {class}"), &fan.after, &at));
    }
    // A stem to the level of the origin shows the height and the distance of a sensor.
    let stem = |p: Vec3| {
        let [forward, left, _] = level(p);
        let foot = sheet.at(view.of([forward, left, 0.0]));
        let start = sheet.at(view.of([0.0; 3]));
        let [x, y] = at(p);
        format!(
            "<path class=\"stem\" d=\"M{:.1} {:.1}L{:.1} {:.1}L{x:.1} {y:.1}\"/>\n",
            start[0], start[1], foot[0], foot[1]
        )
    };
    for fan in &fans {
        body.push_str(&stem(fan.after[0]));
    }
    for (_, p) in &platform.marks {
        body.push_str(&stem(*p));
    }
    for (name, axis) in ["x", "y", "z"].into_iter().zip(axes) {
        let ([x0, y0], [x1, y1]) = (at(Vec3::zeros()), at(axis));
        body.push_str(&format!(
            "<path class=\"axis\" d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\"/>\n"
        ));
        let [x, y] = at(1.15 * axis);
        body.push_str(&text(name, [x, y + 4.0], "middle"));
    }
    for (fan, class) in fans.iter().zip(classes()) {
        let [x, y] = at(fan.after[0]);
        body.push_str(&format!(
            "<circle class=\"dot {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>\n"
        ));
        body.push_str(&text(fan.name, [x + 8.0, y - 5.0], "start"));
    }
    for (name, p) in &platform.marks {
        let [x, y] = at(*p);
        body.push_str(&format!(
            "<path class=\"mark\" d=\"M{x:.1} {:.1}l5 5l-5 5l-5 -5z\"/>\n",
            y - 5.0
        ));
        body.push_str(&text(name, [x + 9.0, y + 4.0], "start"));
    }
    body.push_str(&sheet.scale());
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH:.0} {:.0}\" role=\"img\" aria-label=\"The platform\">\n{body}</svg>\n",
        sheet.height
    );
    let before = if fans.iter().any(|fan| fan.before.is_some()) {
        "; dashed: the mountings given"
    } else {
        ""
    };
    let cut = if is_cut { "; fans are cut off" } else { "" };
    html::figure(
        &svg,
        &format!("Body axes and sensors from the front right, to scale{before}{cut}."),
    )
}

/// Classes of the scanners.
fn classes() -> impl Iterator<Item = String> {
    (0..).map(super::figures::series)
}

/// Corners of a fan in the body frame, the scanner first.
struct Corners<'a> {
    name: &'a str,
    before: Option<Vec<Vec3>>,
    after: Vec<Vec3>,
}

/// The fans, cut off at this distance from the scanner, and whether any was cut.
fn cut<'a>(platform: &Platform, fans: &[Fan<'a>], longest_m: f64) -> (Vec<Corners<'a>>, bool) {
    let mut is_cut = false;
    let mut all = Vec::new();
    let mut outlines = platform.outlines_m.iter();
    for fan in fans {
        let outline = outlines.next().map_or(&[][..], Vec::as_slice);
        let most = outline.iter().map(|p| p.norm()).fold(0.0, f64::max);
        is_cut |= most > longest_m;
        let shrunk = (longest_m / most).min(1.0);
        let corners = |pose: &BodyFromScanner| {
            let start = std::iter::once(Vec3::zeros());
            let ends = outline.iter().map(|p| shrunk * p);
            start.chain(ends).map(|p| pose.map(&p)).collect()
        };
        all.push(Corners {
            name: fan.name,
            before: fan.before.as_ref().map(corners),
            after: corners(&fan.after),
        });
    }
    (all, is_cut)
}

/// The scale from metres to the units of the drawing.
struct Sheet {
    left: f64,
    top: f64,
    unit: f64,
    height: f64,
}

impl Sheet {
    fn around(points: impl Iterator<Item = [f64; 2]>) -> Self {
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in points.filter(|p| p[0].is_finite() && p[1].is_finite()) {
            for i in 0..2 {
                least[i] = least[i].min(p[i]);
                most[i] = most[i].max(p[i]);
            }
        }
        let [wide, high] = [0, 1].map(|i| (most[i] - least[i]).max(1e-3));
        // Names are written to the right of their sensors.
        let unit = ((WIDTH - 3.0 * MARGIN) / wide).min((HEIGHT - 2.0 * MARGIN) / high);
        Self {
            left: least[0] - MARGIN / unit,
            top: most[1] + MARGIN / unit,
            unit,
            height: high * unit + 2.0 * MARGIN,
        }
    }

    fn at(&self, [right, up]: [f64; 2]) -> [f64; 2] {
        [(right - self.left) * self.unit, (self.top - up) * self.unit]
    }

    /// A bar of a round length.
    fn scale(&self) -> String {
        let length_m = number::nice_above(0.1 * WIDTH / self.unit);
        let (x, y) = (12.0, self.height - 10.0);
        format!(
            "<path class=\"axis\" d=\"M{x:.1} {:.1}v5h{:.1}v-5\"/>\n{}",
            y - 5.0,
            length_m * self.unit,
            text(
                &number::with_unit(number::shortest(length_m), "m"),
                [x + length_m * self.unit + 6.0, y],
                "start"
            )
        )
    }
}

fn text(text: &str, [x, y]: [f64; 2], anchor: &str) -> String {
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>\n",
        escape(text)
    )
}

fn polygon(class: &str, corners: &[Vec3], at: &impl Fn(Vec3) -> [f64; 2]) -> String {
    let corners: Vec<String> = corners
        .iter()
        .map(|p| at(*p))
        .map(|[x, y]| format!("{x:.1},{y:.1}"))
        .collect();
    format!(
        "<polygon class=\"{class}\" points=\"{}\"/>\n",
        corners.join(" ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;

    fn platform(axes: BodyAxes) -> Platform {
        Platform {
            axes,
            marks: vec![("prism <1>".into(), Vec3::new(0.1, 0.0, -1.5))],
            outlines_m: vec![vec![Vec3::new(-0.3, 0.0, 0.5), Vec3::new(0.3, 0.0, 0.5)]],
        }
    }

    fn fan(before: Option<BodyFromScanner>) -> Fan<'static> {
        Fan {
            name: "left",
            before,
            after: BodyFromScanner::new(Rotation::identity(), Vec3::new(1.2, -0.5, 0.5)),
        }
    }

    #[test]
    fn up_is_up_in_either_convention() {
        // The vertical place of the prism, which FRD puts above the body and FLU below.
        let height = |axes| {
            let svg = drawing(&platform(axes), &[fan(None)]);
            let (_, mark) = svg.split_once("class=\"mark\" d=\"M").unwrap();
            let (place, _) = mark.split_once('l').unwrap();
            let (_, y) = place.split_once(' ').unwrap();
            y.parse::<f64>().unwrap()
        };
        assert!(height(BodyAxes::Frd) < 60.0);
        assert!(height(BodyAxes::Flu) > 200.0);
    }

    #[test]
    fn fans_are_drawn_before_and_after_and_cut_where_they_are_long() {
        let mut platform = platform(BodyAxes::Frd);
        let svg = drawing(&platform, &[fan(None)]);
        assert!(!svg.contains("fan before") && !svg.contains("cut off"));
        assert!(svg.contains("prism &lt;1&gt;"));
        platform.outlines_m[0][0] *= 100.0;
        let svg = drawing(&platform, &[fan(Some(fan(None).after))]);
        assert!(svg.contains("fan before") && svg.contains("cut off"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(drawing(&platform, &[]), "");
    }
}
