//! `ci run` without a service: runs here, judged by limits and by the results of an earlier run.

use super::{Measured, Results, RunArguments, Settings, file_reader};
use crate::cli::{Bar, progress_bar};
use afterimage::{
    gpu::Gpu,
    image::files::Backend,
    metrics::Value,
    run::{self, report::PresetReport, report::Report},
    sequence::Sequence,
    verdict::{Approved, Line, Outcome, Rules, better, of_repeats, overall, worst_frames},
};
use anyhow::{Context, ensure};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
};

pub fn run(arguments: &RunArguments, rules: &Rules) -> anyhow::Result<Results> {
    let baseline: Vec<Measured> = match &arguments.baseline {
        None => Vec::new(),
        Some(path) => {
            let text = fs::read_to_string(path).with_context(|| format!("--baseline {}", path.display()))?;
            let results: Results =
                serde_json::from_str(&text).with_context(|| format!("--baseline {}", path.display()))?;
            results.reports
        }
    };
    let gpu = Gpu::open(None)?;
    let (mut checks, mut measured) = (Vec::new(), Vec::new());
    let mut names = BTreeSet::new();
    for manifest in &arguments.manifests {
        let sequence = Sequence::open(manifest, &file_reader(Backend::Auto))?;
        ensure!(
            arguments.baseline.is_none() || names.insert(sequence.name().to_owned()),
            "{}: another of these sequences is named `{}`, too, and a baseline compares by name; run them one by one",
            manifest.display(),
            sequence.name()
        );
        let spec = arguments.what.spec(&sequence)?;
        let screen = Bar(progress_bar(sequence.name(), 0));
        let runs: Vec<Report> = (0..arguments.runs)
            .map(|_| run::execute(&spec, &sequence, &gpu, &screen))
            .collect::<Result<_, _>>()?;
        screen.0.finish_and_clear();
        for index in 0..spec.presets.len() {
            let repeats: Vec<&PresetReport> = runs.iter().map(|run| &run.reports[index]).collect();
            let settings = Settings {
                parameters: repeats[0].parameters.clone(),
                history: Some(spec.history),
                skip: Some(spec.skip),
                n_frames: spec.n_frames.filter(|&n| n < sequence.n_frames()),
            };
            let line = Repeats {
                run: &runs[0],
                repeats,
                settings,
            };
            line.judge(rules, &baseline, &mut checks);
            measured.push(line.measured());
        }
    }
    Ok(Results {
        outcome: overall(&checks),
        checks,
        reports: measured,
        server: None,
    })
}

/// The repeats of one preset over one sequence.
struct Repeats<'a> {
    run: &'a Report,
    repeats: Vec<&'a PresetReport>,
    settings: Settings,
}

impl Repeats<'_> {
    /// Every repeat's value, by metric.
    fn values(&self) -> BTreeMap<String, Vec<f64>> {
        let mut values: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for report in &self.repeats {
            for (metric, summary) in &report.summary {
                let value = summary.headline(better(metric));
                values.entry(metric.clone()).or_default().push(value.0);
            }
            let gpu_ms = report.times_ms.values().map(|time| time.median).reduce(|a, b| a + b);
            if let Some(ms) = gpu_ms {
                values.entry("gpu_time_ms".to_owned()).or_default().push(ms);
            }
        }
        values
    }

    fn measured(&self) -> Measured {
        Measured {
            sequence: self.run.sequence.name.clone(),
            recipe: self.repeats[0].preset.clone(),
            settings: self.settings.clone(),
            adapter: self.run.adapter.clone(),
            values: self
                .values()
                .into_iter()
                .map(|(metric, values)| (metric, Value(of_repeats(&values))))
                .collect(),
            metric_versions: self.run.metric_versions.clone(),
            page: None,
            report: None,
        }
    }

    fn judge(&self, rules: &Rules, baseline: &[Measured], checks: &mut Vec<afterimage::verdict::Check>) {
        let (sequence, recipe) = (&self.run.sequence.name, &self.repeats[0].preset);
        let earlier =
            |one: &&Measured| one.sequence == *sequence && one.recipe == *recipe && one.settings == self.settings;
        for (metric, values) in self.values() {
            let version = self.run.metric_versions.get(&metric).copied().unwrap_or(0);
            let same = baseline
                .iter()
                .filter(earlier)
                .filter(|one| one.adapter == self.run.adapter);
            let approved = Approved {
                values: same
                    .filter(|one| one.metric_versions.get(&metric).copied().unwrap_or(0) == version)
                    .filter_map(|one| Some(one.values.get(&metric)?.0))
                    .collect(),
                elsewhere: baseline
                    .iter()
                    .filter(earlier)
                    .any(|one| one.adapter != self.run.adapter),
                ..Approved::default()
            };
            let mut found = rules.judge(&Line {
                series_id: 0,
                sequence,
                recipe,
                metric: &metric,
                values: &values,
                version,
                report_id: None,
                branch: None,
                history: &[],
                approved: &approved,
            });
            for check in found.iter_mut().filter(|check| check.outcome == Outcome::Regression) {
                check.finding.worst_frames = worst_frames(&self.repeats[0].frames, &metric, better(&metric));
            }
            checks.extend(found);
        }
        let measured = self.values().into_keys().collect();
        checks.extend(rules.unmeasured(None, sequence, recipe, &measured));
    }
}
