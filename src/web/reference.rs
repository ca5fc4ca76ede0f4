//! `/api`: the REST API for people, made of the OpenAPI document. Readable without scripts; with them, every endpoint can
//! be tried.

use super::layout::{Page, PageError, Section};
use crate::server::{Shared, document};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde_json::Value;
use std::collections::BTreeMap;

/// `GET /api`
pub async fn page(State(service): Shared) -> Result<Html<String>, PageError> {
    let document = document();
    let mut by_tag: BTreeMap<&str, Vec<Endpoint>> = BTreeMap::new();
    for (path, methods) in document["paths"].as_object().into_iter().flatten() {
        for (method, operation) in methods.as_object().into_iter().flatten() {
            let tag = operation["tags"][0].as_str().unwrap_or_default();
            by_tag.entry(tag).or_default().push(Endpoint {
                method: method.to_uppercase(),
                path,
                operation,
            });
        }
    }
    let content = html! {
        h1 { "REST API" }
        p { (document["info"]["description"].as_str().unwrap_or_default()) " The document: "
            a href="/api/v1/openapi.json" { "openapi.json" } "." }
        label { "Token " input #token type="password" autocomplete="off" placeholder="only where the service asks for one"; }
        @for (tag, endpoints) in &by_tag {
            h2 id=(tag) { (tag) }
            @for endpoint in endpoints { (endpoint.render()) }
        }
        h2 #schemas { "Schemas" }
        @for (name, schema) in document["components"]["schemas"].as_object().into_iter().flatten() {
            details.endpoint id={ "schema-" (name) } {
                summary { code { (name) } " " span.muted { (schema["description"].as_str().unwrap_or_default()) } }
                (fields(schema))
            }
        }
    };
    let page = Page {
        title: "API",
        section: Some(Section::Api),
        script: Some("api.js"),
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

struct Endpoint<'a> {
    method: String,
    path: &'a str,
    operation: &'a Value,
}

impl Endpoint<'_> {
    fn render(&self) -> Markup {
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let parameters = self.operation["parameters"].as_array().map_or(&[][..], Vec::as_slice);
        let scope = self.operation["security"][1]["token"][0].as_str();
        let body = &self.operation["requestBody"]["content"];
        html! {
            details.endpoint id=(text(&self.operation["operationId"])) {
                summary { code { b { (self.method) } " " (self.path) } " " (text(&self.operation["summary"])) }
                @if let Some(scope) = scope { p.muted { "Scope " code { (scope) } } }
                form.try data-method=(self.method) data-path=(self.path) {
                    @for parameter in parameters {
                        label { (text(&parameter["name"])) " " span.muted { (text(&parameter["in"])) ", " (kind(&parameter["schema"])) }
                            input name=(text(&parameter["name"])) data-in=(text(&parameter["in"])) required[parameter["required"] == true];
                            span.muted { (text(&parameter["description"])) }
                        }
                    }
                    @if body["application/json"].is_object() {
                        label { "body " span.muted { (kind(&body["application/json"]["schema"])) }
                            textarea name="body" rows="4" spellcheck="false" { "{}" }
                        }
                    } @else if body.is_object() {
                        label { "body " span.muted { "a file" } input type="file" name="file"; }
                    }
                    button { "Send" }
                    pre.answer hidden {}
                }
                ul { @for (status, answer) in self.operation["responses"].as_object().into_iter().flatten() {
                    li { code { (status) } " " (text(&answer["description"]))
                        @for (media_type, content) in answer["content"].as_object().into_iter().flatten() {
                            " " span.muted { (media_type) } " " (kind(&content["schema"]))
                        }
                    }
                } }
            }
        }
    }
}

/// A schema in a word, with a link where it has a name.
fn kind(schema: &Value) -> Markup {
    if let Some(name) = schema["$ref"].as_str().and_then(|path| path.rsplit('/').next()) {
        return html! { a href={ "#schema-" (name) } { (name) } };
    }
    if schema["items"].is_object() {
        return html! { "list of " (kind(&schema["items"])) };
    }
    if let Some(options) = schema["anyOf"].as_array().or(schema["oneOf"].as_array()) {
        return html! { @for (i, option) in options.iter().enumerate() { @if i > 0 { " or " } (kind(option)) } };
    }
    match (&schema["type"], &schema["const"], &schema["enum"]) {
        (_, Value::String(constant), _) => html! { code { (constant) } },
        (_, _, Value::Array(values)) => {
            let values: Vec<&str> = values.iter().filter_map(Value::as_str).collect();
            html! { code { (values.join(" | ")) } }
        }
        (Value::String(name), ..) => html! { (name) },
        (Value::Array(names), ..) => {
            let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
            html! { (names.join(" or ")) }
        }
        _ => html! { "any" },
    }
}

fn fields(schema: &Value) -> Markup {
    let required: Vec<&str> = schema["required"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    html! {
        @if let Some(properties) = schema["properties"].as_object() {
            ul { @for (name, property) in properties {
                li { code { (name) } " " (kind(property)) @if required.contains(&name.as_str()) { " " span.muted { "always" } }
                    " " (property["description"].as_str().unwrap_or_default()) }
            } }
        } @else { p { (kind(schema)) } }
    }
}
