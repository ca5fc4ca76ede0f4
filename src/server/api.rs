//! The table of endpoints. Each entry makes the route, says which scope it needs, and is a part of the OpenAPI document:
//! the three cannot disagree.

use super::Service;
use crate::store::Scope;
use axum::{
    Router,
    handler::Handler,
    routing::{MethodFilter, on},
};
use schemars::{JsonSchema, SchemaGenerator, generate::SchemaSettings};
use serde_json::{Map, Value, json};
use std::{collections::BTreeMap, sync::Arc};

/// Where the API lies.
pub const BASE: &str = "/api/v1";

/// What one endpoint is.
pub struct Operation {
    id: &'static str,
    tag: &'static str,
    summary: &'static str,
    scope: Option<Scope>,
    query: Vec<Value>,
    body: Option<Value>,
    headers: Vec<Value>,
    answers: BTreeMap<u16, Value>,
}

/// How an operation names the types that it speaks of.
type Describe = fn(Operation, &mut Schemas) -> Operation;

/// The document's schemas. What is read and what is written differ: a field with a default may be left out of the one,
/// and is always there in the other.
pub struct Schemas {
    written: SchemaGenerator,
    read: SchemaGenerator,
}

impl Operation {
    /// A media type with content of its own.
    pub fn media(mut self, status: u16, description: &str, media_types: &[&str]) -> Self {
        let content: Map<String, Value> = media_types
            .iter()
            .map(|media_type| {
                let schema = match *media_type {
                    "application/json" => json!({}),
                    // Of each event.
                    "text/event-stream" => json!({
                        "type": "object",
                        "properties": {
                            "id": {"type": "string"},
                            "event": {"type": "string"},
                            "data": {"type": "string", "contentMediaType": "application/json"},
                        },
                        "required": ["id", "event", "data"],
                    }),
                    text if text.starts_with("text/") => json!({"type": "string"}),
                    _ => json!({"type": "string", "format": "binary"}),
                };
                ((*media_type).to_owned(), json!({ "schema": schema }))
            })
            .collect();
        let answer = self
            .answers
            .entry(status)
            .or_insert_with(|| json!({ "description": description, "content": {} }));
        if let Some(known) = answer["content"].as_object_mut() {
            known.extend(content);
        }
        self
    }

    /// An answer without content.
    pub fn empty(mut self, status: u16, description: &str) -> Self {
        self.answers.insert(status, json!({ "description": description }));
        self
    }

    /// A JSON answer.
    pub fn answer<T: JsonSchema>(mut self, schemas: &mut Schemas, status: u16, description: &str) -> Self {
        let schema = schemas.written.subschema_for::<T>();
        let content = json!({"application/json": {"schema": schema}});
        self.answers
            .insert(status, json!({ "description": description, "content": content }));
        self
    }

    /// A JSON body.
    pub fn body<T: JsonSchema>(mut self, schemas: &mut Schemas) -> Self {
        let schema = schemas.read.subschema_for::<T>();
        self.body = Some(json!({ "required": true, "content": {"application/json": {"schema": schema}} }));
        self
    }

    /// A body that is a file.
    pub fn file(mut self, description: &str) -> Self {
        let content = json!({"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}});
        self.body = Some(json!({ "required": true, "description": description, "content": content }));
        self
    }

    /// Query parameters: the fields of a struct.
    pub fn query<T: JsonSchema>(mut self) -> Self {
        let mut settings = SchemaSettings::draft2020_12();
        settings.inline_subschemas = true;
        let schema = settings.into_generator().into_root_schema_for::<T>();
        let schema = serde_json::to_value(schema).unwrap_or_default();
        let required: Vec<&str> = schema["required"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        for (name, property) in schema["properties"].as_object().into_iter().flatten() {
            let mut property = property.clone();
            let description = property
                .as_object_mut()
                .and_then(|property| property.remove("description"));
            without_null(&mut property);
            self.query.push(json!({
                "name": name, "in": "query", "required": required.contains(&name.as_str()),
                "description": description, "schema": property,
            }));
        }
        self
    }

    /// A request header.
    pub fn header(mut self, name: &str, description: &str, schema: Value) -> Self {
        self.headers.push(json!({
            "name": name, "in": "header", "required": false, "description": description, "schema": schema,
        }));
        self
    }
}

/// A parameter that is left out is not sent as null.
fn without_null(schema: &mut Value) {
    if let Some(types) = schema["type"].as_array() {
        let rest: Vec<Value> = types.iter().filter(|name| *name != "null").cloned().collect();
        schema["type"] = if rest.len() == 1 { rest[0].clone() } else { json!(rest) };
    }
    if let Some(options) = schema["anyOf"].as_array() {
        let rest: Vec<Value> = options
            .iter()
            .filter(|option| option["type"] != "null")
            .cloned()
            .collect();
        if let [only] = &rest[..] {
            *schema = only.clone();
        }
    }
    if let Some(schema) = schema.as_object_mut() {
        schema.retain(|name, value| !(name == "default" && value.is_null()));
        if let Some(values) = schema.get_mut("enum").and_then(Value::as_array_mut) {
            values.retain(|value| !value.is_null());
        }
    }
}

/// The router, the scopes and the document under construction.
pub struct Api {
    router: Router<Arc<Service>>,
    schemas: Schemas,
    paths: BTreeMap<String, Map<String, Value>>,
    scopes: Scopes,
}

/// Which scope an endpoint needs, by method and path.
pub type Scopes = BTreeMap<(&'static str, String), Option<Scope>>;

impl Api {
    /// Without any endpoint.
    pub fn new() -> Self {
        let generator = || {
            let mut settings = SchemaSettings::draft2020_12();
            settings.definitions_path = "/components/schemas".into();
            settings.meta_schema = None;
            settings
        };
        Self {
            router: Router::new(),
            schemas: Schemas {
                written: generator().for_serialize().into_generator(),
                read: generator().into_generator(),
            },
            paths: BTreeMap::new(),
            scopes: Scopes::new(),
        }
    }

    /// Adds an endpoint: `GET /jobs`, the scope it needs (none: open to all), its id, its resource, a summary, and what it
    /// takes and gives.
    pub fn route<H: Handler<T, Arc<Service>>, T: 'static>(
        mut self,
        method_and_path: &'static str,
        scope: impl Into<Option<Scope>>,
        [id, tag, summary]: [&'static str; 3],
        handler: H,
        describe: Describe,
    ) -> Self {
        let (method, path) = method_and_path.split_once(' ').expect("a method and a path");
        let filter = match method {
            "GET" => MethodFilter::GET,
            "HEAD" => MethodFilter::HEAD,
            "POST" => MethodFilter::POST,
            "PUT" => MethodFilter::PUT,
            "DELETE" => MethodFilter::DELETE,
            _ => unreachable!("no endpoint has another method"),
        };
        let scope = scope.into();
        let operation = Operation {
            id,
            tag,
            summary,
            scope,
            query: Vec::new(),
            body: None,
            headers: Vec::new(),
            answers: BTreeMap::new(),
        };
        let operation = describe(operation, &mut self.schemas);
        self.router = self.router.route(path, on(filter, handler));
        self.scopes.insert((method, format!("{BASE}{path}")), scope);
        self.paths
            .entry(path.to_owned())
            .or_default()
            .insert(method.to_lowercase(), operation.document(method, path));
        self
    }

    /// The routes (to be nested under [`BASE`]), which scope each needs, and the OpenAPI document.
    pub fn finish(mut self) -> (Router<Arc<Service>>, Scopes, Value) {
        let mut schemas = self.schemas.written.take_definitions(true);
        let read = self.schemas.read.take_definitions(true);
        let mut paths = serde_json::to_value(&self.paths).unwrap_or_default();
        let mut renamed = Vec::new();
        let mut incoming = Map::new();
        for (name, schema) in read {
            match schemas.get(&name) {
                Some(known) if *known == schema => {}
                Some(_) => {
                    renamed.push(name.clone());
                    incoming.insert(format!("{name}Input"), schema);
                }
                None => drop(incoming.insert(name, schema)),
            }
        }
        // What refers to an incoming form is bodies, and other incoming forms.
        for name in &renamed {
            let (old, new) = (
                format!("#/components/schemas/{name}"),
                format!("#/components/schemas/{name}Input"),
            );
            incoming.values_mut().for_each(|schema| rename(schema, &old, &new));
            for operation in paths
                .as_object_mut()
                .into_iter()
                .flatten()
                .flat_map(|(_, path)| path.as_object_mut())
                .flatten()
            {
                rename(&mut operation.1["requestBody"], &old, &new);
            }
        }
        for operation in paths
            .as_object_mut()
            .into_iter()
            .flatten()
            .flat_map(|(_, path)| path.as_object_mut())
            .flatten()
        {
            if operation.1["requestBody"].is_null() {
                operation
                    .1
                    .as_object_mut()
                    .map(|operation| operation.remove("requestBody"));
            }
        }
        schemas.extend(incoming);
        schemas.insert("Problem".to_owned(), problem_schema());
        let document = json!({
            "openapi": "3.1.0",
            "jsonSchemaDialect": "https://json-schema.org/draft/2020-12/schema",
            "info": {
                "title": "Afterimage",
                "version": env!("CARGO_PKG_VERSION"),
                "description": "Validates temporal anti-aliasing and keeps the history of every metric. Errors are problem \
                                details (RFC 9457) with a stable `code`.",
                "license": {"name": "MIT OR Apache-2.0", "identifier": "MIT OR Apache-2.0"},
            },
            "servers": [{"url": BASE}],
            "paths": paths,
            "components": {
                "schemas": schemas,
                "securitySchemes": {
                    "token": {"type": "http", "scheme": "bearer", "description": "A token made by `afterimage token create`."},
                },
            },
        });
        (self.router, self.scopes, document)
    }
}

fn rename(schema: &mut Value, old: &str, new: &str) {
    match schema {
        Value::Object(fields) => {
            for (name, value) in fields {
                match value {
                    Value::String(target) if name == "$ref" && target == old => new.clone_into(target),
                    value => rename(value, old, new),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| rename(item, old, new)),
        _ => {}
    }
}

impl Operation {
    fn document(mut self, method: &str, path: &str) -> Value {
        let mut parameters: Vec<Value> = path
            .split('/')
            .filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'))
            .map(path_parameter)
            .collect();
        parameters.append(&mut self.query);
        parameters.append(&mut self.headers);
        if method == "POST" {
            parameters.push(json!({
                "name": "Idempotency-Key", "in": "header", "required": false,
                "description": "Any text. The same request with the same key is done once; its answer is kept for a day.",
                "schema": {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-~]+$"},
            }));
        }
        let mut responses: Map<String, Value> = self
            .answers
            .into_iter()
            .map(|(status, answer)| (status.to_string(), answer))
            .collect();
        let problem = json!({"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}});
        responses.insert(
            "default".to_owned(),
            json!({ "description": "What was wrong, or that the service is busy (then with `Retry-After`).", "content": problem }),
        );
        let security = match self.scope {
            None => json!([]),
            Some(scope) => json!([{}, {"token": [scope]}]),
        };
        json!({
            "operationId": self.id, "tags": [self.tag], "summary": self.summary, "parameters": parameters,
            "requestBody": self.body, "responses": responses, "security": security,
        })
    }
}

/// What stands for the parts of paths.
fn path_parameter(name: &str) -> Value {
    let number = || json!({"type": "integer", "format": "int64", "minimum": 1});
    let (description, schema) = match name {
        "sequence" => (
            "Content hash, or the name it was last put under.",
            json!({"type": "string", "minLength": 1, "maxLength": 100, "pattern": "^[A-Za-z0-9_.-]+$"}),
        ),
        "sha256" => (
            "SHA-256 of the content in hexadecimal.",
            json!({"type": "string", "pattern": "^[0-9a-f]{64}$"}),
        ),
        "image" => (
            "`output`, `reference`, `error`, `history`, `skipped` or a spatial metric's id, with `.png` or `.exr`.",
            json!({"type": "string", "pattern": "^[a-z0-9_.]+\\.(png|exr)$"}),
        ),
        "picture" => (
            "A cell's index in the matrix, from 0, with `.png`.",
            json!({"type": "string", "pattern": "^[0-9]{1,9}\\.png$"}),
        ),
        "frame" => (
            "Frame index, from 0.",
            json!({"type": "integer", "format": "int64", "minimum": 0}),
        ),
        "preset" => ("Preset id.", json!({"type": "string", "pattern": "^[a-z0-9_]+$"})),
        "project" => (
            "Project name.",
            json!({"type": "string", "minLength": 1, "maxLength": 100, "pattern": "^[A-Za-z0-9_.-]+$"}),
        ),
        _ => ("Number.", number()),
    };
    json!({ "name": name, "in": "path", "required": true, "description": description, "schema": schema })
}

fn problem_schema() -> Value {
    json!({
        "type": "object",
        "description": "Problem details, RFC 9457.",
        "required": ["type", "title", "status", "code", "detail"],
        "properties": {
            "type": {"type": "string"},
            "title": {"type": "string", "description": "The status in words."},
            "status": {"type": "integer"},
            "code": {"type": "string", "description": "Stable; what programs match on."},
            "detail": {"type": "string", "description": "For people."},
            "field": {"type": "string", "description": "The field of the request that is wrong."},
            "missing": {"type": "array", "items": {"type": "string"}, "description": "Blobs to be put first."},
        },
    })
}
