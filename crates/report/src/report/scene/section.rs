//! The section of the page that holds the scenes and their viewer.

use serde_json::{Value, json};

use super::Scene;
use super::packed::Packed;
use crate::comparison::MountingKind;
use crate::number;
use crate::report::html::escape;
use crate::report::tables::mounting_name;
use crate::results::Drive;

/// The viewer: built from `web/` by `just web`.
const VIEWER: &str = include_str!("../../../../../web/dist/viewer.js");

/// The scenes of all drives (markup); empty without any.
pub fn section(drives: &[Drive], scenes: &[Option<Scene>]) -> String {
    let drives = drives.iter().zip(scenes);
    let scenes = drives.filter_map(|(drive, scene)| Some((drive.name.as_str(), scene.as_ref()?)));
    let mut headers: Vec<Value> = Vec::new();
    let mut data = String::new();
    let mut counts = Vec::new();
    for (place, (name, scene)) in scenes.enumerate() {
        let mut packed = Packed::of(scene, name, &variant_names(scene));
        let script = format!("scene-drive-{place}");
        packed.header["script"] = json!(script);
        data.push_str(&format!(
            "<script type=\"application/octet-stream;base64\" id=\"{script}\">{}</script>\n",
            packed.base64()
        ));
        headers.push(packed.header);
        counts.push(counted(name, scene));
    }
    if headers.is_empty() {
        return String::new();
    }
    format!(
        "<p>The clouds with every mounting, the reference and the trajectory. Points are spread evenly over \
         each drive ({}); near the places of the sections, every point that was compared is there.</p>\n\
         <div id=\"scene-viewer\" class=\"scene\"><p class=\"note\">The clouds are drawn by a script in this \
         page.</p></div>\n\
         <script type=\"application/json\" id=\"scene-header\">{}</script>\n{data}<script>\n{VIEWER}</script>\n",
        escape(&counts.join("; ")),
        in_script(&json!({ "format": 1, "drives": headers })),
    )
}

/// The names of the variants of a scene, as in the rest of the page.
fn variant_names(scene: &Scene) -> Vec<&'static str> {
    let kinds = scene.variants.iter().map(|variant| variant.kind);
    let is_joint = kinds.clone().any(|kind| kind == MountingKind::TwoStep);
    kinds.map(|kind| mounting_name(kind, is_joint)).collect()
}

/// The number of points of a drive that are shown, in words.
fn counted(name: &str, scene: &Scene) -> String {
    let shown = scene.fans.iter().flat_map(|fan| &fan.counts);
    let shown: usize = shown.map(|&count| usize::from(count)).sum();
    let total: u64 = scene.fans.iter().map(|fan| fan.total).sum();
    format!(
        "{name}: {} of {}",
        number::count(shown),
        number::count(total as usize)
    )
}

/// JSON that no HTML parser reads as markup.
fn in_script(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}
