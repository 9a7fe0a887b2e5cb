//! The scales of a comparison, as they are told.

use crate::comparison::MeasuredScales;
use crate::geometry::Vec3;
use crate::number;
use crate::report::content::Fact;
use crate::tiles::{Compared, Comparison, NormalSource, Orientation};

/// The scales that were used and what they follow from, as paragraph of the summary.
pub fn told(comparison: &Comparison, work: &Compared) -> String {
    let normals = normals(comparison, work);
    let mut out = format!(
        "\nscales of the comparison\n  {:<21}{}",
        normals.label, normals.value
    );
    for scale in scales(comparison, work) {
        let origin = if scale.is_given { "given" } else { "measured" };
        out.push_str(&format!(
            "\n  {:<21}{} m, {origin} ({})",
            scale.name, scale.value_m, scale.option
        ));
    }
    if let Some(measured) = &work.measured {
        out.push_str(&format!("\n{}", reasons(measured)));
    }
    out
}

/// The places towards which normals are oriented.
pub fn viewpoints(work: &Compared) -> &[Vec3] {
    match &work.orientation {
        Some(Orientation::SeenFrom(places)) => places,
        _ => &[],
    }
}

/// Where the normals come from and point to.
pub fn normals(comparison: &Comparison, work: &Compared) -> Fact {
    let text = |direction: &Vec3| format!("{}, {}, {}", direction.x, direction.y, direction.z);
    let value = match (&comparison.normals, &work.orientation) {
        (NormalSource::Fixed(direction), _) => format!("all {} (--direction)", text(direction)),
        (_, Some(Orientation::Direction(direction))) => {
            format!(
                "of the reference, towards {} (--orientation)",
                text(direction)
            )
        }
        (_, Some(Orientation::SeenFrom(places))) => match places.as_slice() {
            [place] => format!("of the reference, towards {} (--viewpoint)", text(place)),
            _ => format!(
                "of the reference, towards the nearest of {} viewpoints (--viewpoint)",
                places.len()
            ),
        },
        (_, Some(Orientation::Scanners) | None) => "of the core points (--core)".to_owned(),
    };
    Fact {
        label: "normals".to_owned(),
        value,
    }
}

/// A scale with the option that sets it.
pub struct Scale {
    /// What it is the length of.
    pub name: &'static str,
    /// The option of `boresight compare` that sets it.
    pub option: &'static str,
    /// Its value or values, metres.
    pub value_m: String,
    /// Whether it was given.
    pub is_given: bool,
}

/// The scales that were used, in the order in which they act.
pub fn scales(comparison: &Comparison, work: &Compared) -> Vec<Scale> {
    let (settings, given) = (&work.settings, &comparison.settings.scales);
    let scale = |name, option, value_m, is_given| Scale {
        name,
        option,
        value_m,
        is_given,
    };
    let mut scales = Vec::new();
    if comparison.core.is_none() {
        scales.push(scale(
            "core points apart",
            "--core-spacing-m",
            settings.core_spacing_m.to_string(),
            given.core_spacing_m.is_some(),
        ));
    }
    if work.orientation.is_some() {
        scales.push(scale(
            "radius for normals",
            "--normal-radii-m",
            list(&settings.normal_radii_m),
            given.normal_radii_m.is_some(),
        ));
    }
    scales.push(scale(
        "radius of cylinders",
        "--cylinder-radius-m",
        settings.cylinder_radius_m.to_string(),
        given.cylinder_radius_m.is_some(),
    ));
    scales.push(scale(
        "half their length",
        "--max-distance-m",
        settings.max_distance_m.to_string(),
        given.max_distance_m.is_some(),
    ));
    scales
}

/// What the measured scales follow from.
pub fn reasons(measured: &MeasuredScales) -> String {
    let length = |metres: f64| format!("{} m", number::significant(metres, 2));
    let mut out = format!(
        "Measured from the clouds, after Lague et al. (2013): points of the reference are {} apart, those of the cloud \
         {}; in half of the area, a cylinder contains 20 points of each",
        length(measured.reference_spacing_m),
        length(measured.compared_spacing_m)
    );
    if let Some(roughness_m) = measured.roughness_m {
        out.push_str(&format!(
            "; around the radius for normals, the reference is {} rough",
            length(roughness_m)
        ));
    }
    if let Some(distance_m) = measured.distance_m {
        out.push_str(&format!(
            "; along the normals, nine of ten places that have a counterpart lie within {} of it",
            length(distance_m)
        ));
    }
    out + "."
}

/// Numbers separated by commas, as an option takes them.
pub fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(f64::to_string).collect();
    values.join(",")
}
