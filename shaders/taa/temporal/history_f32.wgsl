// History without rounding.

alias HistoryStore = texture_storage_2d<rgba32float, write>;

fn round_history(c: vec3f) -> vec3f {
    return c;
}
