//! `boresight features`

use std::path::PathBuf;

use super::context::{Context, Force, out_folder};
use super::values::positive;
use crate::cloud::Neighbourhood;
use crate::cloud::shape::Feature;
use crate::error::Result;
use crate::pipeline::{self, Outcome};
use crate::tiles::FeatureSettings;

/// Compute features of every point's neighbourhood: omnivariance, planarity, normals, ...
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Features {
    /// The cloud, in any format
    cloud: PathBuf,
    /// Neighbourhoods of the N nearest points, including the point itself [default: 50]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    neighbours: Option<u32>,
    /// Neighbourhoods of all points within this radius instead
    #[arg(long, value_name = "M", value_parser = positive, conflicts_with = "neighbours")]
    radius_m: Option<f64>,
    /// Features to write, separated by commas: omnivariance, linearity, planarity, sphericity,
    /// anisotropy, eigenentropy, change_of_curvature, verticality, eigenvalue_sum, normal,
    /// neighbours, radius, or all [default: omnivariance,linearity,planarity,sphericity,
    /// verticality,change_of_curvature,normal]
    #[arg(long, value_name = "NAME,...", value_parser = chosen, value_delimiter = ',')]
    features: Option<Vec<Chosen>>,
    /// Folder for the results [default: `out` next to the cloud]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Memory limit, at least about 150: a cloud that needs more is processed tile by tile, with
    /// the same results [default: half of the free memory]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    memory_mb: Option<u64>,
    #[command(flatten)]
    force: Force,
}

/// An item of the list.
#[derive(Debug, Clone)]
enum Chosen {
    One(Feature),
    All,
}

impl Features {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let out = out_folder(&self.out, &self.cloud);
        let settings = self.settings();
        let inputs = [self.cloud.clone()];
        context.logged(&out, &inputs, self.force, |options| {
            pipeline::features(&self.cloud, &settings, options, &context.terminal)
        })
    }

    fn settings(&self) -> FeatureSettings {
        let default = FeatureSettings::default();
        let neighbourhood = match (self.neighbours, self.radius_m) {
            (_, Some(radius_m)) => Neighbourhood::Within(radius_m),
            (Some(k), None) => Neighbourhood::Nearest(k as usize),
            (None, None) => default.neighbourhood,
        };
        let mut features = Vec::new();
        for chosen in self.features.iter().flatten() {
            let named = match chosen {
                Chosen::One(feature) => std::slice::from_ref(feature),
                Chosen::All => &Feature::ALL,
            };
            for feature in named {
                // A name given twice is one dimension.
                if !features.contains(feature) {
                    features.push(*feature);
                }
            }
        }
        FeatureSettings {
            neighbourhood,
            features: if features.is_empty() {
                default.features
            } else {
                features
            },
            memory_bytes: self.memory_mb.map(|mb| mb.saturating_mul(1_000_000)),
        }
    }
}

fn chosen(text: &str) -> std::result::Result<Chosen, String> {
    let text = text.trim();
    if text == "all" {
        return Ok(Chosen::All);
    }
    if let Some(feature) = Feature::ALL.iter().find(|feature| feature.name() == text) {
        return Ok(Chosen::One(*feature));
    }
    let names = Feature::ALL.iter().map(|feature| feature.name());
    let nearest = names
        .chain(["all"])
        .map(|name| (strsim::damerau_levenshtein(text, name), name))
        .min();
    Err(match nearest {
        Some((distance, name)) if distance <= 1 + name.len() / 3 => {
            format!("there is no such feature; did you mean `{name}`?")
        }
        _ => {
            let names: Vec<&str> = Feature::ALL.iter().map(|feature| feature.name()).collect();
            format!(
                "there is no such feature; there are {}, all",
                names.join(", ")
            )
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        features: Features,
    }

    fn settings(arguments: &[&str]) -> FeatureSettings {
        let line = ["x", "a.laz"].iter().chain(arguments);
        Line::try_parse_from(line).unwrap().features.settings()
    }

    #[test]
    fn the_help_names_every_feature_and_the_defaults() {
        use clap::CommandFactory;
        let command = Line::command();
        let help = |name: &str| {
            let mut arguments = command.get_arguments();
            let arg = arguments.find(|arg| arg.get_id() == name).unwrap().clone();
            arg.get_help().unwrap().to_string()
        };
        let text = help("features");
        let (names, default) = text.split_once("[default: ").unwrap();
        for feature in Feature::ALL {
            assert!(names.contains(feature.name()), "{}", feature.name());
        }
        let default: String = default.trim_end_matches(']').split_whitespace().collect();
        assert_eq!(settings(&["--features", &default]), settings(&[]));
        assert!(help("neighbours").contains("[default: 50]"));
        assert_eq!(settings(&[]).neighbourhood, Neighbourhood::Nearest(50));
    }

    #[test]
    fn lists_keep_their_order_and_drop_repetitions() {
        use Feature::{Normal, Planarity};
        let chosen = settings(&["--features", "planarity,normal,planarity"]).features;
        assert_eq!(chosen, [Planarity, Normal]);
        assert_eq!(
            settings(&["--features", "all,normal"]).features,
            Feature::ALL
        );
        let radius = settings(&["--radius-m", "0.5", "--memory-mb", "300"]);
        assert_eq!(radius.neighbourhood, Neighbourhood::Within(0.5));
        assert_eq!(radius.memory_bytes, Some(300_000_000));
    }
}
