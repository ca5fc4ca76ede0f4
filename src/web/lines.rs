//! Which lines a query asks for: any metrics of any sequences, recipes, environments and branches. Shared by the trends and
//! by what is embedded elsewhere.

use super::{layout::PageError, parts, query::Query};
use crate::{
    server::Service,
    store::{GPU_TIME, Point, Series, SeriesFilter},
};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};
use std::collections::BTreeSet;

/// Lines whose points are read at once.
const AT_ONCE: usize = 8;

/// What is chosen; empty means all.
pub struct Choice {
    pub metrics: Vec<String>,
    pub projects: Vec<String>,
    pub sequences: Vec<String>,
    pub recipes: Vec<String>,
    pub environments: Vec<i64>,
    pub branches: Vec<String>,
}

/// A line and its newest results.
pub struct Line {
    pub series: Series,
    pub branch: Option<String>,
    pub points: Vec<Point>,
}

impl Choice {
    /// What a query says. A sequence's name, as people write it into an address, means its latest content and what was
    /// measured elsewhere under that name before the content was here.
    pub async fn of(service: &Service, query: &Query) -> Result<Self, PageError> {
        let mut sequences = Vec::new();
        for name in query.all("sequence") {
            let stored = service.store.sequence(&name).await?;
            sequences.extend(stored.map(|sequence| sequence.hash).filter(|hash| *hash != name));
            sequences.push(name);
        }
        let mut metrics = query.all("metric");
        if metrics.is_empty() {
            let known = service.store.metric_names().await?;
            let usual = ["psnr", "ssim"]
                .into_iter()
                .find(|metric| known.iter().any(|name| name == metric));
            metrics.push(
                usual
                    .or(known.first().map(String::as_str))
                    .unwrap_or(GPU_TIME)
                    .to_owned(),
            );
        }
        let environments = query.all("environment");
        Ok(Self {
            metrics,
            projects: query.all("project"),
            sequences,
            recipes: query.all("recipe"),
            environments: environments.iter().filter_map(|id| id.parse().ok()).collect(),
            branches: query.all("branch"),
        })
    }

    fn admits(&self, series: &Series) -> bool {
        let has = |chosen: &[String], one: &str| chosen.is_empty() || chosen.iter().any(|name| name == one);
        has(&self.projects, &series.project)
            && has(&self.sequences, &parts::subject_of(series))
            && (has(&self.recipes, &parts::recipe(series)) || has(&self.recipes, &series.preset))
            && (self.environments.is_empty() || self.environments.contains(&series.environment_id))
    }

    /// Every line that has results of a metric, with the newest `limit` of them; at most `max_lines`, and how many more
    /// there are. `all` is every series.
    pub async fn lines(
        &self,
        service: &Service,
        all: &[Series],
        metric: &str,
        limit: usize,
        max_lines: usize,
    ) -> Result<(Vec<Line>, usize), PageError> {
        let branches: Vec<Option<String>> = match self.branches.is_empty() {
            true => vec![None],
            false => self.branches.iter().cloned().map(Some).collect(),
        };
        let mut wanted = Vec::new();
        for series in all.iter().filter(|series| self.admits(series)) {
            wanted.extend(branches.iter().map(|branch| (series.clone(), branch.clone())));
        }
        let read = stream::iter(wanted.into_iter().map(async |(series, branch)| {
            let points = service.store.points(&series, metric, branch.as_deref(), limit).await?;
            Ok::<_, PageError>(Line { series, branch, points })
        }));
        let mut lines: Vec<Line> = read.buffered(AT_ONCE).try_collect().await?;
        lines.retain(|line| !line.points.is_empty());
        let n_more = lines.len().saturating_sub(max_lines);
        lines.truncate(max_lines);
        Ok((lines, n_more))
    }
}

/// Every series.
pub async fn all_series(service: &Service) -> Result<Vec<Series>, PageError> {
    Ok(service.store.series(&SeriesFilter::default()).await?)
}

/// What tells the lines of a chart apart.
pub struct Style {
    pub name: String,
    /// A number a recipe, so that it looks alike on every sequence.
    pub color: usize,
    /// A number a sequence, environment and branch.
    pub dash: usize,
}

/// Names that say no more than is needed, colours and dashes.
pub fn styles(lines: &[Line]) -> Vec<Style> {
    let names: [fn(&Line) -> String; 4] = [
        |line| line.series.sequence_name.clone(),
        |line| parts::recipe(&line.series),
        |line| parts::environment(&line.series.environment),
        |line| line.branch.clone().unwrap_or_default(),
    ];
    let differ = names.map(|name| lines.iter().map(name).collect::<BTreeSet<_>>().len() > 1);
    let recipes: Vec<String> = lines
        .iter()
        .map(names[1])
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    let rest = |line: &Line| format!("{} {} {}", names[0](line), names[2](line), names[3](line));
    let others: Vec<String> = lines.iter().map(rest).collect::<BTreeSet<_>>().into_iter().collect();
    let place = |all: &[String], one: &str| all.iter().position(|name| name == one).unwrap_or_default();
    let style = |line: &Line| {
        let told = [differ[0], true, differ[2], differ[3]];
        let name: Vec<String> = names
            .iter()
            .zip(told)
            .filter(|(_, told)| *told)
            .map(|(name, _)| name(line))
            .collect();
        let (color, dash) = match recipes.len() {
            // One recipe: colours are free for what else differs.
            1 => (place(&others, &rest(line)), 0),
            _ => (
                place(&recipes, &parts::recipe(&line.series)),
                place(&others, &rest(line)),
            ),
        };
        Style {
            name: name.join(" · "),
            color,
            dash,
        }
    };
    lines.iter().map(style).collect()
}
