// Reads messages of OpenIGTLink from its standard input with the C++ library, checks and all, makes each anew from what
// the library understood, and writes it to its standard output.
#include <cstdio>
#include <cstring>
#include <list>
#include <string>
#include <vector>

#include <igtlCapabilityMessage.h>
#include <igtlImageMessage.h>
#include <igtlImageMetaMessage.h>
#include <igtlLabelMetaMessage.h>
#include <igtlMessageHeader.h>
#include <igtlNDArrayMessage.h>
#include <igtlPointMessage.h>
#include <igtlPolyDataMessage.h>
#include <igtlPositionMessage.h>
#include <igtlQuaternionTrackingDataMessage.h>
#include <igtlSensorMessage.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTrackingDataMessage.h>
#include <igtlTransformMessage.h>

using namespace igtl;

static void copy(TransformMessage &in, TransformMessage &out) {
    Matrix4x4 matrix;
    in.GetMatrix(matrix);
    out.SetMatrix(matrix);
}

static void copy(PositionMessage &in, PositionMessage &out) {
    float position[3], quaternion[4];
    in.GetPosition(position);
    in.GetQuaternion(quaternion);
    out.SetPackType(in.GetPackType());
    out.SetPosition(position);
    out.SetQuaternion(quaternion);
}

static void copy(ImageMessage &in, ImageMessage &out) {
    int size[3], part[3], offset[3];
    float spacing[3];
    Matrix4x4 matrix;
    in.GetDimensions(size);
    in.GetSubVolume(part, offset);
    in.GetSpacing(spacing);
    in.GetMatrix(matrix);
    out.SetDimensions(size);
    out.SetSubVolume(part, offset);
    out.SetSpacing(spacing);
    out.SetNumComponents(in.GetNumComponents());
    out.SetScalarType(in.GetScalarType());
    out.SetEndian(in.GetEndian());
    out.SetCoordinateSystem(in.GetCoordinateSystem());
    out.AllocateScalars();
    out.SetMatrix(matrix);
    std::memcpy(out.GetScalarPointer(), in.GetScalarPointer(), in.GetImageSize());
}

static void copy(StatusMessage &in, StatusMessage &out) {
    out.SetCode(in.GetCode());
    out.SetSubCode(in.GetSubCode());
    out.SetErrorName(in.GetErrorName());
    out.SetStatusString(in.GetStatusString());
}

static void copy(StringMessage &in, StringMessage &out) {
    out.SetEncoding(in.GetEncoding());
    out.SetString(in.GetString());
}

static void copy(CapabilityMessage &in, CapabilityMessage &out) { out.SetTypes(in.GetTypes()); }

static void copy(SensorMessage &in, SensorMessage &out) {
    out.SetLength(in.GetLength());
    out.SetUnit(in.GetUnit());
    for (unsigned i = 0; i < in.GetLength(); ++i) out.SetValue(i, in.GetValue(i));
}

static void copy(TrackingDataMessage &in, TrackingDataMessage &out) {
    for (int i = 0; i < in.GetNumberOfTrackingDataElements(); ++i) {
        TrackingDataElement::Pointer tool, made = TrackingDataElement::New();
        Matrix4x4 matrix;
        in.GetTrackingDataElement(i, tool);
        tool->GetMatrix(matrix);
        made->SetName(tool->GetName());
        made->SetType(tool->GetType());
        made->SetMatrix(matrix);
        out.AddTrackingDataElement(made);
    }
}

static void copy(QuaternionTrackingDataMessage &in, QuaternionTrackingDataMessage &out) {
    for (int i = 0; i < in.GetNumberOfQuaternionTrackingDataElements(); ++i) {
        QuaternionTrackingDataElement::Pointer tool, made = QuaternionTrackingDataElement::New();
        float position[3], quaternion[4];
        in.GetQuaternionTrackingDataElement(i, tool);
        tool->GetPosition(position);
        tool->GetQuaternion(quaternion);
        made->SetName(tool->GetName());
        made->SetType(tool->GetType());
        made->SetPosition(position);
        made->SetQuaternion(quaternion);
        out.AddQuaternionTrackingDataElement(made);
    }
}

static void copy(PointMessage &in, PointMessage &out) {
    for (int i = 0; i < in.GetNumberOfPointElement(); ++i) {
        PointElement::Pointer point, made = PointElement::New();
        igtlUint8 colour[4];
        igtlFloat32 position[3];
        in.GetPointElement(i, point);
        point->GetRGBA(colour);
        point->GetPosition(position);
        made->SetName(point->GetName());
        made->SetGroupName(point->GetGroupName());
        made->SetRGBA(colour);
        made->SetPosition(position);
        made->SetRadius(point->GetRadius());
        made->SetOwner(point->GetOwner());
        out.AddPointElement(made);
    }
}

static void copy(ImageMetaMessage &in, ImageMetaMessage &out) {
    for (int i = 0; i < in.GetNumberOfImageMetaElement(); ++i) {
        ImageMetaElement::Pointer image, made = ImageMetaElement::New();
        igtlUint16 size[3];
        TimeStamp::Pointer stamp = TimeStamp::New();
        in.GetImageMetaElement(i, image);
        image->GetSize(size);
        image->GetTimeStamp(stamp);
        made->SetName(image->GetName());
        made->SetDeviceName(image->GetDeviceName());
        made->SetModality(image->GetModality());
        made->SetPatientName(image->GetPatientName());
        made->SetPatientID(image->GetPatientID());
        made->SetTimeStamp(stamp);
        made->SetSize(size);
        made->SetScalarType(image->GetScalarType());
        out.AddImageMetaElement(made);
    }
}

static void copy(LabelMetaMessage &in, LabelMetaMessage &out) {
    for (int i = 0; i < in.GetNumberOfLabelMetaElement(); ++i) {
        LabelMetaElement::Pointer label, made = LabelMetaElement::New();
        igtlUint16 size[3];
        igtlUint8 colour[4];
        in.GetLabelMetaElement(i, label);
        label->GetSize(size);
        label->GetRGBA(colour);
        made->SetName(label->GetName());
        made->SetDeviceName(label->GetDeviceName());
        made->SetLabel(label->GetLabel());
        made->SetRGBA(colour);
        made->SetSize(size);
        made->SetOwner(label->GetOwner());
        out.AddLabelMetaElement(made);
    }
}

static PolyDataCellArray::Pointer copy_of(PolyDataCellArray *cells) {
    PolyDataCellArray::Pointer made = PolyDataCellArray::New();
    for (unsigned i = 0; cells && i < cells->GetNumberOfCells(); ++i) {
        std::vector<igtlUint32> cell(cells->GetCellSize(i));
        cells->GetCell(i, cell.data());
        made->AddCell(static_cast<int>(cell.size()), cell.data());
    }
    return made;
}

static void copy(PolyDataMessage &in, PolyDataMessage &out) {
    PolyDataPointArray::Pointer points = PolyDataPointArray::New();
    for (int i = 0; i < in.GetPoints()->GetNumberOfPoints(); ++i) {
        igtlFloat32 point[3];
        in.GetPoints()->GetPoint(i, point);
        points->AddPoint(point);
    }
    out.SetPoints(points);
    out.SetVertices(copy_of(in.GetVertices()));
    out.SetLines(copy_of(in.GetLines()));
    out.SetPolygons(copy_of(in.GetPolygons()));
    out.SetTriangleStrips(copy_of(in.GetTriangleStrips()));
    for (int i = 0; i < in.GetNumberOfAttributes(); ++i) {
        PolyDataAttribute *attribute = in.GetAttribute(i);
        PolyDataAttribute::Pointer made = PolyDataAttribute::New();
        std::vector<igtlFloat32> values(attribute->GetSize() * attribute->GetNumberOfComponents());
        attribute->GetData(values.data());
        made->SetType(attribute->GetType(), attribute->GetNumberOfComponents());
        made->SetName(attribute->GetName());
        made->SetSize(attribute->GetSize());
        made->SetData(values.data());
        out.AddAttribute(made);
    }
}

static void copy(StartTrackingDataMessage &in, StartTrackingDataMessage &out) {
    out.SetResolution(in.GetResolution());
    out.SetCoordinateName(in.GetCoordinateName());
}

static void copy(RTSTrackingDataMessage &in, RTSTrackingDataMessage &out) { out.SetStatus(in.GetStatus()); }

static void copy(StartQuaternionTrackingDataMessage &in, StartQuaternionTrackingDataMessage &out) {
    out.SetResolution(in.GetResolution());
    out.SetCoordinateName(in.GetCoordinateName());
}

static void copy(RTSQuaternionTrackingDataMessage &in, RTSQuaternionTrackingDataMessage &out) {
    out.SetStatus(in.GetStatus());
}

template <class Element> static void copy_array(NDArrayMessage &in, NDArrayMessage &out) {
    static Array<Element> array; // the message keeps its address
    array.SetSize(in.GetArray()->GetSize());
    array.SetArray(in.GetArray()->GetRawArray());
    out.SetArray(in.GetType(), &array);
}

static void copy(NDArrayMessage &in, NDArrayMessage &out) {
    switch (in.GetType()) {
    case NDArrayMessage::TYPE_INT8: return copy_array<igtlInt8>(in, out);
    case NDArrayMessage::TYPE_UINT8: return copy_array<igtlUint8>(in, out);
    case NDArrayMessage::TYPE_INT16: return copy_array<igtlInt16>(in, out);
    case NDArrayMessage::TYPE_UINT16: return copy_array<igtlUint16>(in, out);
    case NDArrayMessage::TYPE_INT32: return copy_array<igtlInt32>(in, out);
    case NDArrayMessage::TYPE_UINT32: return copy_array<igtlUint32>(in, out);
    case NDArrayMessage::TYPE_FLOAT32: return copy_array<igtlFloat32>(in, out);
    case NDArrayMessage::TYPE_FLOAT64: return copy_array<igtlFloat64>(in, out);
    case NDArrayMessage::TYPE_COMPLEX: return copy_array<igtlComplex>(in, out);
    }
}

/// Of queries that are a header alone there is nothing to copy.
static void copy(MessageBase &, MessageBase &) {}

/// Whether the library took the message; it is written then.
template <class Type> static bool echo(MessageHeader::Pointer header) {
    typename Type::Pointer in = Type::New(), out = Type::New();
    in->SetMessageHeader(header);
    in->AllocatePack();
    const std::size_t size = header->GetBodySizeToRead();
    if (size && std::fread(in->GetPackBodyPointer(), 1, size, stdin) != size) return false;
    if (!(in->Unpack(1) & MessageHeader::UNPACK_BODY) && size) return false;
    TimeStamp::Pointer stamp = TimeStamp::New();
    in->GetTimeStamp(stamp);
    copy(*in, *out);
    out->SetDeviceName(in->GetDeviceName());
    out->SetTimeStamp(stamp);
    out->Pack();
    return std::fwrite(out->GetPackPointer(), 1, out->GetPackSize(), stdout) == std::size_t(out->GetPackSize());
}

static bool echo_any(MessageHeader::Pointer header) {
    const std::string type = header->GetDeviceType();
    if (type == "TRANSFORM") return echo<TransformMessage>(header);
    if (type == "POSITION") return echo<PositionMessage>(header);
    if (type == "IMAGE") return echo<ImageMessage>(header);
    if (type == "STATUS") return echo<StatusMessage>(header);
    if (type == "STRING") return echo<StringMessage>(header);
    if (type == "CAPABILITY") return echo<CapabilityMessage>(header);
    if (type == "SENSOR") return echo<SensorMessage>(header);
    if (type == "TDATA") return echo<TrackingDataMessage>(header);
    if (type == "QTDATA") return echo<QuaternionTrackingDataMessage>(header);
    if (type == "POINT") return echo<PointMessage>(header);
    if (type == "IMGMETA") return echo<ImageMetaMessage>(header);
    if (type == "LBMETA") return echo<LabelMetaMessage>(header);
    if (type == "POLYDATA") return echo<PolyDataMessage>(header);
    if (type == "STT_TDATA") return echo<StartTrackingDataMessage>(header);
    if (type == "RTS_TDATA") return echo<RTSTrackingDataMessage>(header);
    if (type == "NDARRAY") return echo<NDArrayMessage>(header);
    if (type == "STT_QTDATA") return echo<StartQuaternionTrackingDataMessage>(header);
    if (type == "RTS_QTDATA") return echo<RTSQuaternionTrackingDataMessage>(header);
    if (type == "STP_TDATA") return echo<StopTrackingDataMessage>(header);
    if (type == "STP_QTDATA") return echo<StopQuaternionTrackingDataMessage>(header);
    if (type == "GET_TRANS") return echo<GetTransformMessage>(header);
    if (type == "GET_IMAGE") return echo<GetImageMessage>(header);
    if (type == "GET_STATUS") return echo<GetStatusMessage>(header);
    if (type == "GET_CAPABIL") return echo<GetCapabilityMessage>(header);
    if (type == "GET_IMGMETA") return echo<GetImageMetaMessage>(header);
    if (type == "GET_LBMETA") return echo<GetLabelMetaMessage>(header);
    if (type == "GET_POINT") return echo<GetPointMessage>(header);
    if (type == "GET_POLYDATA") return echo<GetPolyDataMessage>(header);
    std::fprintf(stderr, "type %s\n", type.c_str());
    return false;
}

int main() {
    for (;;) {
        MessageHeader::Pointer header = MessageHeader::New();
        header->InitPack();
        const std::size_t read = std::fread(header->GetPackPointer(), 1, header->GetPackSize(), stdin);
        if (!read) return 0;
        if (read != std::size_t(header->GetPackSize())) return 2;
        header->Unpack();
        if (!echo_any(header)) {
            std::fprintf(stderr, "refused %s %s\n", header->GetDeviceType(), header->GetDeviceName());
            return 1;
        }
    }
}
