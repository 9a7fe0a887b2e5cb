//! `boresight compare`

use std::path::PathBuf;

use super::context::{Context, Force, out_folder};
use super::pdf::Pdf;
use super::values::{direction, not_negative, place, positive};
use crate::comparison::{Aggregation, Detection, OpenSettings, Scales};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::pipeline::{self, Outcome};
use crate::tiles::{Comparison, NormalSource, Orientation};

/// Measure the distances between two clouds along their normals (M3C2)
///
/// Distances are positive where the cloud lies beyond the reference in the direction of the normal.
/// Sizes are radii; with --diameter they are diameters, as in CloudCompare. Those that are not given
/// follow from the spacing of the points and the roughness of the reference, and are printed.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Compare {
    /// The cloud to compare
    cloud: PathBuf,
    /// The reference cloud
    reference: PathBuf,
    /// Folder for the results [default: `out` next to the cloud]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Core points: any cloud; the columns normal_x, normal_y, normal_z of a table are used as
    /// normals unless radii or a direction are given [default: the reference, thinned]
    #[arg(long, value_name = "FILE", conflicts_with = "core_spacing_m")]
    core: Option<PathBuf>,
    /// Spacing of the core points [default: the diameter of the cylinder]
    #[arg(long, value_name = "M", value_parser = positive)]
    core_spacing_m: Option<f64>,
    /// Radii of the neighbourhoods for normals, separated by commas; the most planar one is used
    /// [default: one, from which the neighbourhoods are 25 times as wide as they are rough]
    #[arg(long, value_name = "M,...", value_parser = positive, value_delimiter = ',')]
    normal_radii_m: Option<Vec<f64>>,
    /// One direction instead of estimated normals: `vertical`, or east,north,up
    #[arg(long, value_name = "E,N,U", value_parser = direction, allow_hyphen_values = true, conflicts_with_all = ["normal_radii_m", "orientation"])]
    direction: Option<Vec3>,
    /// Direction that estimated normals are oriented towards, east,north,up [default: towards the
    /// nearest position of a scanner in the file of the reference, or of the cloud; 0,0,1 if there is none]
    #[arg(long, value_name = "E,N,U", value_parser = direction, allow_hyphen_values = true)]
    orientation: Option<Vec3>,
    /// A place from which the surface was seen, east,north,up in metres; estimated normals point
    /// towards the nearest one (may be given more than once)
    #[arg(long, value_name = "E,N,U", value_parser = place, allow_hyphen_values = true, conflicts_with_all = ["orientation", "direction"])]
    viewpoint: Vec<Vec3>,
    /// Radius of the cylinder [default: 20 points of either cloud in it]
    #[arg(long, value_name = "M", value_parser = positive)]
    cylinder_radius_m: Option<f64>,
    /// --normal-radii-m and --cylinder-radius-m are diameters; --max-distance-m stays half the
    /// length of the cylinder, which is CloudCompare's projection depth
    #[arg(long)]
    diameter: bool,
    /// Half length of the cylinder [default: five radii, more if the clouds lie farther apart]
    #[arg(long, value_name = "M", value_parser = positive)]
    max_distance_m: Option<f64>,
    /// Cylinders extend along the normal only, not against it, for both clouds
    #[arg(long)]
    one_sided: bool,
    /// Median and inter-quartile range instead of mean and standard deviation
    #[arg(long)]
    robust: bool,
    /// Level of detection from Student's t distribution, valid for few points too
    #[arg(long)]
    student: bool,
    /// Minimum number of points of each cloud in the cylinder [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    min_points: Option<u32>,
    /// Registration error, added to the level of detection [default: 0]
    #[arg(long, value_name = "M", value_parser = not_negative)]
    registration_error_m: Option<f64>,
    /// Memory limit; larger clouds (LAS, LAZ) are compared tile by tile, with the same results
    /// [default: half of the free memory]
    #[arg(long, value_name = "MB")]
    memory_mb: Option<u32>,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    force: Force,
}

impl Compare {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        let out = out_folder(&self.out, &self.cloud);
        let comparison = Comparison {
            cloud: self.cloud.clone(),
            reference: self.reference.clone(),
            core: self.core.clone(),
            normals: self.normals(),
            settings: self.settings(),
            memory_bytes: self.memory_mb.map(|mb| u64::from(mb) * 1_000_000),
        };
        context.logged(&out, &comparison.inputs(), self.force, |options| {
            let outcome = pipeline::compare(&comparison, options, &context.terminal)?;
            printer.print(&options.out.join("compare.html"), &options.kept, outcome)
        })
    }

    fn normals(&self) -> NormalSource {
        let orientation = match self.orientation {
            Some(direction) => Orientation::Direction(direction),
            None if self.viewpoint.is_empty() => Orientation::Scanners,
            None => Orientation::SeenFrom(self.viewpoint.clone()),
        };
        match self.direction {
            Some(direction) => NormalSource::Fixed(direction),
            None if self.normal_radii_m.is_some() => NormalSource::Reference { orientation },
            None => NormalSource::Core { orientation },
        }
    }

    fn settings(&self) -> OpenSettings {
        let radius = |value: f64| if self.diameter { value / 2.0 } else { value };
        let radii = |values: &Vec<f64>| values.iter().copied().map(radius).collect();
        OpenSettings {
            scales: Scales {
                core_spacing_m: self.core_spacing_m,
                normal_radii_m: self.normal_radii_m.as_ref().map(radii),
                cylinder_radius_m: self.cylinder_radius_m.map(radius),
                max_distance_m: self.max_distance_m,
            },
            registration_error_m: self.registration_error_m.unwrap_or(0.0),
            aggregation: if self.robust {
                Aggregation::Median
            } else {
                Aggregation::Mean
            },
            detection: if self.student {
                Detection::Student
            } else {
                Detection::Normal
            },
            one_sided: self.one_sided,
            min_points: self.min_points,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::*;
    use crate::comparison::ComparisonSettings;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        compare: Compare,
    }

    fn parse(args: &[&str]) -> std::result::Result<Compare, String> {
        let line = ["compare", "a.laz", "b.laz"].iter().chain(args);
        Line::try_parse_from(line)
            .map(|line| line.compare)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn the_defaults_named_in_the_help_are_those_of_the_stage() {
        let default = ComparisonSettings::default();
        let named = |name: &str| {
            let command = Line::command();
            let arg = command
                .get_arguments()
                .find(|arg| arg.get_id() == name)
                .unwrap()
                .clone();
            let help = arg.get_help().unwrap().to_string();
            let (_, value) = help.split_once("[default: ").unwrap();
            value.trim_end_matches(']').parse::<f64>().unwrap()
        };
        assert_eq!(named("registration_error_m"), default.registration_error_m);
        assert_eq!(named("min_points"), f64::from(default.min_points));
        assert_eq!(parse(&[]).unwrap().settings(), OpenSettings::default());
    }

    #[test]
    fn diameters_are_halved_and_depths_are_not() {
        let args = [
            "--normal-radii-m=0.3,0.5",
            "--cylinder-radius-m=0.2",
            "--max-distance-m=0.7",
        ];
        let radii = parse(&args).unwrap().settings();
        assert_eq!(radii.scales.normal_radii_m, Some(vec![0.3, 0.5]));
        let diameters = parse(&[&args[..], &["--diameter"]].concat()).unwrap();
        let expected = Scales {
            normal_radii_m: Some(vec![0.15, 0.25]),
            cylinder_radius_m: Some(0.1),
            ..radii.scales
        };
        assert_eq!(diameters.settings().scales, expected);
        // Scales that are not given are measured, and are radii.
        let default = parse(&["--diameter"]).unwrap().settings();
        assert_eq!(default, OpenSettings::default());
    }

    #[test]
    fn directions_of_normals_are_parsed_or_refused() {
        let normals = |args: &[&str]| parse(args).unwrap().normals();
        let up = Vec3::z();
        assert_eq!(normals(&["--direction=vertical"]), NormalSource::Fixed(up));
        let west = Vec3::new(-1.0, 0.0, 0.5);
        assert_eq!(
            normals(&["--direction", "-1,0,.5"]),
            NormalSource::Fixed(west)
        );
        let core = |orientation| NormalSource::Core { orientation };
        assert_eq!(normals(&[]), core(Orientation::Scanners));
        let places = normals(&["--viewpoint=0,0,0", "--viewpoint", "-1,0,.5"]);
        let seen_from = Orientation::SeenFrom(vec![Vec3::zeros(), west]);
        assert_eq!(places, core(seen_from));
        let turned = normals(&["--orientation=-1,0,.5", "--normal-radii-m=1"]);
        let orientation = Orientation::Direction(west);
        assert_eq!(turned, NormalSource::Reference { orientation });
        for bad in ["0,0,0", "1,2", "1,2,3,4", "nan,0,0", "down"] {
            assert!(parse(&["--direction", bad]).is_err(), "{bad}");
        }
        for both in [
            &["--direction=vertical", "--normal-radii-m=1"][..],
            &["--core=a.csv", "--core-spacing-m=1"],
            &["--min-points=0"],
            &["--viewpoint=1,2"],
            &["--viewpoint=1,2,3", "--orientation=0,0,1"],
        ] {
            assert!(parse(both).is_err(), "{both:?}");
        }
    }
}
