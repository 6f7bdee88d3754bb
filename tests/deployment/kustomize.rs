//! As much of kustomize as the manifests use: resources, and JSON patches of one object each.

use json_patch::{Patch, patch};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(non_snake_case, reason = "the file's own word")]
struct Kustomization {
    apiVersion: String,
    kind: String,
    resources: Vec<String>,
    #[serde(default)]
    patches: Vec<Change>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    target: Target,
    patch: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Target {
    kind: String,
    name: String,
}

/// The objects that `kubectl apply -k FOLDER` would hand over.
pub(crate) fn build(folder: &Path) -> Vec<Value> {
    let file = folder.join("kustomization.yaml");
    let kustomization: Kustomization = serde_yaml_ng::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let version = (kustomization.apiVersion.as_str(), kustomization.kind.as_str());
    assert_eq!(version, ("kustomize.config.k8s.io/v1beta1", "Kustomization"), "{}", file.display());
    let mut objects = Vec::new();
    for resource in &kustomization.resources {
        let path = folder.join(resource);
        if path.is_dir() {
            objects.extend(build(&path));
        } else {
            objects.extend(documents(&path));
        }
    }
    for Change { target, patch: changes } in kustomization.patches {
        let wanted = |object: &&mut Value| object["kind"] == target.kind && object["metadata"]["name"] == target.name;
        let object = objects.iter_mut().find(wanted);
        let object = object.unwrap_or_else(|| panic!("{}: no {} {}", file.display(), target.kind, target.name));
        let changes: Value = serde_yaml_ng::from_str(&changes).unwrap();
        let changes: Patch = serde_json::from_value(changes).unwrap();
        patch(object, &changes).unwrap_or_else(|error| panic!("{}: {}: {error}", file.display(), target.name));
    }
    objects
}

fn documents(file: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(file).unwrap();
    let documents = serde_yaml_ng::Deserializer::from_str(&text).map(Value::deserialize);
    documents.map(|document| document.unwrap_or_else(|error| panic!("{}: {error}", file.display()))).collect()
}
