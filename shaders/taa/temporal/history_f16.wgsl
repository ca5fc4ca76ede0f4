// History as engines keep it. Some drivers truncate on an f16 store, and a truncating history drifts dark:
// rounding first makes the store exact everywhere.

alias HistoryStore = texture_storage_2d<rgba16float, write>;

fn round_history(c: vec3f) -> vec3f {
    if (!guards) {
        return c;
    }
    return quantizeToF16(c);
}
