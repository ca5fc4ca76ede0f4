// The domain that colours are compared, blended and stored in. CPU twin: src/taa/reference/color.rs.

const DOMAIN_LINEAR: u32 = 0u;
const DOMAIN_TONEMAPPED: u32 = 1u;
const DOMAIN_DISPLAY: u32 = 2u;

@group(0) @binding(8) var<uniform> display: Display;

// From linear. Tone mapping bounds the weight of one bright sample; filters that look for edges expect display values.
fn to_domain(linear: vec3f, domain: u32) -> vec3f {
    switch (domain) {
        case DOMAIN_TONEMAPPED: { return reinhard_max(linear); }
        case DOMAIN_DISPLAY: { return to_display(linear, display); }
        default: { return linear; }
    }
}

fn from_domain(c: vec3f, domain: u32) -> vec3f {
    switch (domain) {
        case DOMAIN_TONEMAPPED: { return inverse_reinhard_max(c); }
        case DOMAIN_DISPLAY: { return from_display(c, display); }
        default: { return c; }
    }
}
