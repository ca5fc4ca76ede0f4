// A workgroup's strips added up pairwise, so that little has to come back to the host: on a GPU. Stands in for
// strips_apart.wgsl.

var<workgroup> of_lanes: array<Sample, WORKGROUP_X * WORKGROUP_Y>;

fn hand_in(strip: Strip, sums: array<Sample, N_CLASSES>) {
    let index = strip.workgroup.y * strip.n_workgroups.x + strip.workgroup.x;
    for (var kind = 0u; kind < N_CLASSES; kind++) {
        of_lanes[strip.lane] = sums[kind];
        for (var half = WORKGROUP_X * WORKGROUP_Y / 2u; half > 0u; half /= 2u) {
            workgroupBarrier();
            if (strip.lane < half) {
                for (var term = 0u; term < N_TERMS; term++) {
                    of_lanes[strip.lane][term] += of_lanes[strip.lane + half][term];
                }
            }
        }
        if (strip.lane == 0u) {
            partial_sums[index][kind] = of_lanes[0];
        }
        workgroupBarrier();
    }
}
