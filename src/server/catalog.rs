//! What this service offers and knows of: presets and their parameters, metrics, adapters, projects; and whether it is well.

use super::{ApiError, ApiPath, Shared};
use crate::{
    metrics::{Listing, Metric},
    run::report::AdapterInfo,
    store::{Branch, Environment, SeriesFilter},
    taa::{
        PRESETS, Preset,
        recipe::{Parameter, parameters},
    },
};
use axum::{Json, extract::State, http::StatusCode};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;

/// What answers.
#[derive(Serialize, JsonSchema)]
pub struct Health {
    /// `ok`.
    status: &'static str,
    /// Version of the program.
    version: &'static str,
    /// Git revision of the build.
    revision: &'static str,
}

/// `GET /health`: 200 while the database answers. Says nothing of the GPU: a service without one still shows history.
pub async fn health(State(service): Shared) -> Result<Json<Health>, ApiError> {
    service.store.ping().await?;
    Ok(Json(Health {
        status: "ok",
        version: env!("CARGO_PKG_VERSION"),
        revision: env!("AFTERIMAGE_REVISION"),
    }))
}

/// `GET /presets`
pub async fn presets() -> Json<&'static [Preset]> {
    Json(&PRESETS)
}

/// A preset with its parameters described.
#[derive(Serialize, JsonSchema)]
pub struct RecipeListing {
    /// Preset id.
    id: &'static str,
    /// What it is.
    description: &'static str,
    /// Where it was published.
    publication: &'static str,
    /// Every parameter, with the preset's value as default.
    parameters: Vec<Parameter>,
}

/// Every preset with its parameters.
#[derive(Serialize, JsonSchema)]
pub struct RecipeList {
    /// In the order of `GET /presets`.
    recipes: Vec<RecipeListing>,
}

fn recipe_listing(preset: &'static Preset) -> RecipeListing {
    let values = preset.recipe.to_json();
    let parameter = |parameter: &Parameter| Parameter {
        default: values[&parameter.name].clone(),
        ..parameter.clone()
    };
    RecipeListing {
        id: preset.id,
        description: preset.description,
        publication: preset.publication,
        parameters: parameters().iter().map(parameter).collect(),
    }
}

/// `GET /recipes`
pub async fn recipes() -> Json<RecipeList> {
    const ALL: &[Preset] = &PRESETS;
    Json(RecipeList {
        recipes: ALL.iter().map(recipe_listing).collect(),
    })
}

/// `GET /recipes/{preset}`
pub async fn recipe(ApiPath(id): ApiPath<String>) -> Result<Json<RecipeListing>, ApiError> {
    const ALL: &[Preset] = &PRESETS;
    let found = ALL.iter().find(|preset| preset.id == id);
    let preset = found.ok_or_else(|| ApiError::not_found(format!("there is no preset `{id}`; see /api/v1/presets")))?;
    Ok(Json(recipe_listing(preset)))
}

/// `GET /metrics`
pub async fn metrics() -> Json<Vec<Listing>> {
    Json(Metric::list())
}

/// `GET /adapter`
pub async fn adapter(State(service): Shared) -> Result<Json<AdapterInfo>, ApiError> {
    match &service.adapter {
        Ok(adapter) => Ok(Json(adapter.clone())),
        Err(reason) => Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "no_adapter", reason)),
    }
}

/// An environment that reports were made in.
#[derive(Serialize, JsonSchema)]
pub struct EnvironmentListing {
    /// Its number, as series carry it.
    id: i64,
    /// Adapter, driver, operating system, clocks.
    #[serde(flatten)]
    environment: Environment,
}

/// Every environment.
#[derive(Serialize, JsonSchema)]
pub struct EnvironmentList {
    /// By number.
    environments: Vec<EnvironmentListing>,
}

/// `GET /environments`
pub async fn environments(State(service): Shared) -> Result<Json<EnvironmentList>, ApiError> {
    let series = service.store.series(&SeriesFilter::default()).await?;
    let known: BTreeMap<i64, Environment> = series
        .into_iter()
        .map(|series| (series.environment_id, series.environment))
        .collect();
    let environments = known
        .into_iter()
        .map(|(id, environment)| EnvironmentListing { id, environment })
        .collect();
    Ok(Json(EnvironmentList { environments }))
}

/// Every project.
#[derive(Serialize, JsonSchema)]
pub struct ProjectList {
    /// Names.
    projects: Vec<String>,
}

/// `GET /projects`
pub async fn projects(State(service): Shared) -> Result<Json<ProjectList>, ApiError> {
    let projects = service.store.projects().await?;
    Ok(Json(ProjectList { projects }))
}

/// Branches of a project.
#[derive(Serialize, JsonSchema)]
pub struct BranchList {
    /// By name.
    branches: Vec<Branch>,
}

/// `GET /projects/{project}/branches`
pub async fn branches(State(service): Shared, ApiPath(project): ApiPath<String>) -> Result<Json<BranchList>, ApiError> {
    if !service.store.projects().await?.contains(&project) {
        return Err(ApiError::not_found(format!("there is no project `{project}`")));
    }
    let branches = service.store.branches(&project).await?;
    Ok(Json(BranchList { branches }))
}
