//! `boresight compare`

use std::path::PathBuf;

use super::{Context, beside};
use crate::error::Result;
use crate::pipeline::{self, Outcome};
use crate::project::ComparisonSettings;

/// Measure the distances between two clouds along their normals (M3C2)
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Compare {
    /// The cloud to judge
    cloud: PathBuf,
    /// The cloud to judge it by
    reference: PathBuf,
    /// Folder of the results [default: `out` beside the cloud]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Spacing of the core points [default: 0.02]
    #[arg(long, value_name = "M", value_parser = positive)]
    core_spacing_m: Option<f64>,
    /// Radii of the neighbourhoods for normals, separated by commas [default: 0.04]
    #[arg(long, value_name = "M,...", value_parser = positive, value_delimiter = ',')]
    normal_radii_m: Option<Vec<f64>>,
    /// Radius of the cylinder [default: 0.02]
    #[arg(long, value_name = "M", value_parser = positive)]
    cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder [default: 0.1]
    #[arg(long, value_name = "M", value_parser = positive)]
    max_distance_m: Option<f64>,
    /// Registration error, added to the level of detection [default: 0]
    #[arg(long, value_name = "M", value_parser = not_negative)]
    registration_error_m: Option<f64>,
}

impl Compare {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let out = match &self.out {
            Some(out) => out.clone(),
            None => beside(&self.cloud),
        };
        let settings = self.settings();
        context.logged(&out, |options| {
            let (cloud, reference) = (&self.cloud, &self.reference);
            pipeline::compare(cloud, reference, &settings, options, &context.terminal)
        })
    }

    fn settings(&self) -> ComparisonSettings {
        let default = ComparisonSettings::default();
        ComparisonSettings {
            core_spacing_m: self.core_spacing_m.unwrap_or(default.core_spacing_m),
            normal_radii_m: self
                .normal_radii_m
                .clone()
                .unwrap_or(default.normal_radii_m),
            cylinder_radius_m: self.cylinder_radius_m.unwrap_or(default.cylinder_radius_m),
            max_distance_m: self.max_distance_m.unwrap_or(default.max_distance_m),
            registration_error_m: self
                .registration_error_m
                .unwrap_or(default.registration_error_m),
        }
    }
}

pub(super) fn positive(text: &str) -> std::result::Result<f64, String> {
    number(text)
        .filter(|x| *x > 0.0)
        .ok_or_else(|| "expected metres above 0".to_owned())
}

fn not_negative(text: &str) -> std::result::Result<f64, String> {
    number(text)
        .filter(|x| *x >= 0.0)
        .ok_or_else(|| "expected metres, 0 or more".to_owned())
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        compare: Compare,
    }

    #[test]
    fn the_defaults_named_in_the_help_are_those_of_the_stage() {
        use clap::CommandFactory;
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
        assert_eq!(named("core_spacing_m"), default.core_spacing_m);
        assert_eq!([named("normal_radii_m")], default.normal_radii_m[..]);
        assert_eq!(named("cylinder_radius_m"), default.cylinder_radius_m);
        assert_eq!(named("max_distance_m"), default.max_distance_m);
        assert_eq!(named("registration_error_m"), default.registration_error_m);
    }
}
