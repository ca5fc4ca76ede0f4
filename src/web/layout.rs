//! What all pages share: the frame around them, the data for their scripts, and how they say that something is wrong.

use super::assets;
use crate::server::{ApiError, Service};
use axum::{
    http::{StatusCode, Uri},
    response::{Html, IntoResponse, Response},
};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

/// A page's place in the navigation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Section {
    Overview,
    Trends,
    Sequences,
    Jobs,
    Bench,
    Stress,
    Alerts,
    Api,
}

/// A page before it has its frame.
pub struct Page<'a> {
    /// Shown in the browser's tab, before the service's name.
    pub title: &'a str,
    pub section: Option<Section>,
    /// The module that brings the page to life, if any.
    pub script: Option<&'static str>,
    /// Whether it draws charts.
    pub charts: bool,
    pub content: Markup,
}

impl Page<'_> {
    /// The whole document.
    pub fn render(self, service: &Service) -> Html<String> {
        let adapter = match &service.adapter {
            Ok(adapter) => {
                html! { span.adapter title=(format!("{} {}", adapter.driver, adapter.driver_version)) { (adapter.name) } }
            }
            Err(_) => html! { span.adapter { "no GPU adapter" } },
        };
        Html(self.document(adapter).into_string())
    }

    fn document(self, adapter: Markup) -> Markup {
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) " · Afterimage" }
                    link rel="icon" href=(assets::url("icon.svg"));
                    meta name="color-scheme" content="light dark";
                    script src=(assets::url("theme.js")) {}
                    link rel="stylesheet" href=(assets::url("style.css"));
                    @if self.charts {
                        link rel="stylesheet" href=(assets::url("uplot.css"));
                        script defer src=(assets::url("uplot.js")) {}
                    }
                    script type="module" src=(assets::url("page.js")) {}
                    @if let Some(script) = self.script { script type="module" src=(assets::url(script)) {} }
                }
                body {
                    a.skip href="#main" { "To the content" }
                    header.top {
                        a.name href="/" { "Afterimage" }
                        nav aria-label="Pages" {
                            @for (section, href, name) in [
                                (Section::Overview, "/", "Overview"),
                                (Section::Trends, "/trends", "Trends"),
                                (Section::Sequences, "/sequences", "Sequences"),
                                (Section::Jobs, "/jobs", "Jobs"),
                                (Section::Bench, "/bench", "Time and error"),
                                (Section::Stress, "/stress", "Stability"),
                                (Section::Alerts, "/alerts", "Alerts"),
                                (Section::Api, "/api", "API"),
                            ] {
                                a href=(href) aria-current=[(self.section == Some(section)).then_some("page")] { (name) }
                            }
                        }
                        (adapter)
                        div.tools {}
                    }
                    main #main { (self.content) }
                }
            }
        }
    }
}

/// Data for the page's script. `<` is escaped, so that no text in it can end the element.
pub fn script_data(data: &impl Serialize) -> Result<Markup, PageError> {
    let json = serde_json::to_string(data).map_err(ApiError::internal)?;
    let json = PreEscaped(json.replace('<', "\\u003c"));
    Ok(html! { script #data type="application/json" { (json) } })
}

/// An error shown as a page.
#[derive(Debug)]
pub struct PageError(ApiError);

impl PageError {
    /// For an address that means nothing.
    pub fn nothing_at(path: &str) -> Self {
        Self(ApiError::not_found(format!("there is nothing at {path}")))
    }
}

impl<E: Into<ApiError>> From<E> for PageError {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

impl IntoResponse for PageError {
    fn into_response(self) -> Response {
        let title = match self.0.status() {
            StatusCode::NOT_FOUND => "Not here",
            StatusCode::INTERNAL_SERVER_ERROR => "Something broke",
            _ => "That did not work",
        };
        let page = Page {
            title,
            section: None,
            script: None,
            charts: false,
            content: html! {
                h1 { (title) }
                p { (self.0.detail()) "." }
                p { a href="/" { "To the overview" } }
            },
        };
        (self.0.status(), Html(page.document(html! {}).into_string())).into_response()
    }
}

/// The answer to an address that no page has.
pub async fn unknown_page(uri: Uri) -> PageError {
    PageError::nothing_at(uri.path())
}
