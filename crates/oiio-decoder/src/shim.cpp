// OpenImageIO behind a C interface. No exception leaves a function: each returns 0 or null where it failed, and
// shim_error() then says why. One thread uses it at a time.

#include <OpenImageIO/imageio.h>

#include <cstdint>
#include <exception>
#include <memory>
#include <string>

namespace {
std::string last_error;

// Runs `body`, which returns whether it succeeded.
template <typename Body> int guarded(Body body)
{
    try {
        last_error.clear();
        return body() ? 1 : 0;
    } catch (const std::exception& error) {
        last_error = error.what();
    } catch (...) {
        last_error = "an unknown exception";
    }
    return 0;
}

bool fail(const std::string& reason)
{
    last_error = reason.empty() ? "OpenImageIO gave no reason" : reason;
    return false;
}
}

extern "C" {

// One part; the same fields in the same order as `PartSpec` in oiio.rs.
struct PartSpec {
    int32_t data[4];     // x, y, width, height
    int32_t display[4];
    int32_t n_channels;
    int32_t bits;        // bits a sample that the file declares; 0 where it does not
    int32_t is_flat;     // no volume, no deep samples
};

const char* shim_error() { return last_error.c_str(); }

void shim_configure(int32_t image_mib, int32_t max_channels)
{
    OIIO::attribute("limits:imagesize_MB", image_mib);
    OIIO::attribute("limits:channels", max_channels);
    OIIO::attribute("try_all_readers", 0);
    // 0: as many as there are processors.
    OIIO::attribute("threads", 0);
    OIIO::attribute("exr_threads", 0);
    // OpenEXRCore, the other reader, cannot read DWA in 2.4.
    OIIO::attribute("openexr:core", 0);
}

// `format` is the plug-in's name, not an extension: only that reader sees the file.
OIIO::ImageInput* shim_open(const char* path, const char* format)
{
    std::unique_ptr<OIIO::ImageInput> input;
    guarded([&] {
        input = OIIO::ImageInput::create(format);
        if (!input)
            return fail(OIIO::geterror());
        OIIO::ImageSpec spec, config;
        config.attribute("oiio:UnassociatedAlpha", 1);
        if (input->open(path, spec, config))
            return true;
        fail(input->geterror());
        input.reset();
        return false;
    });
    return input.release();
}

void shim_close(OIIO::ImageInput* input)
{
    guarded([&] { delete input; return true; });
}

// Makes a part current and describes it.
int shim_part(OIIO::ImageInput* input, int32_t part, PartSpec* out)
{
    return guarded([&] {
        if (!input->seek_subimage(part, 0))
            return fail(input->geterror());
        const OIIO::ImageSpec& spec = input->spec();
        *out = { { spec.x, spec.y, spec.width, spec.height },
                 { spec.full_x, spec.full_y, spec.full_width, spec.full_height },
                 spec.nchannels, spec.get_int_attribute("oiio:BitsPerSample"), spec.depth <= 1 && !spec.deep };
        return true;
    });
}

// Name of the current part; valid until the next call.
const char* shim_part_name(OIIO::ImageInput* input)
{
    static std::string name;
    guarded([&] { name = std::string(input->spec().get_string_attribute("name")); return true; });
    return name.c_str();
}

// Name of a channel of the current part, valid until another part is sought; null where there is none.
const char* shim_channel_name(OIIO::ImageInput* input, int32_t channel)
{
    const std::vector<std::string>& names = input->spec().channelnames;
    return channel >= 0 && size_t(channel) < names.size() ? names[channel].c_str() : nullptr;
}

// OpenImageIO's base type of a channel of the current part.
int32_t shim_channel_type(OIIO::ImageInput* input, int32_t channel)
{
    return input->spec().channelformat(channel).basetype;
}

// Channels [begin, end) of a part, interleaved, as `type`.
int shim_read(OIIO::ImageInput* input, int32_t part, int32_t begin, int32_t end, int32_t type, void* out)
{
    return guarded([&] {
        const OIIO::TypeDesc format { OIIO::TypeDesc::BASETYPE(type) };
        return input->read_image(part, 0, begin, end, format, out) || fail(input->geterror());
    });
}

}
