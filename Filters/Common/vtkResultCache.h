// The results that a filter computed last, so that going back to a time is instant. Header only, internal.
#ifndef vtkResultCache_h
#define vtkResultCache_h

#include "vtkAbstractArray.h"
#include "vtkAlgorithm.h"
#include "vtkCellData.h"
#include "vtkDataArray.h"
#include "vtkDataObject.h"
#include "vtkDataSet.h"
#include "vtkDataSetAttributes.h"
#include "vtkFieldData.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkPointData.h"
#include "vtkPointSet.h"
#include "vtkPoints.h"
#include "vtkSmartPointer.h"
#include "vtkStringArray.h"
#include "vtkTable.h"

#include <algorithm>
#include <cstring>
#include <list>
#include <set>
#include <string>
#include <vector>

namespace rimflow {

/// What a filter put out for what its inputs held, up to a limit of memory; the least recently used goes
/// first. A result counts as known when all arrays of all inputs are the same, the objects themselves or
/// their contents to the last bit, and the filter was not modified since. So it does not matter why an input
/// changed (another time, a setting upstream, a Body that was found again with another velocity), nor whether
/// the pipeline noticed; comparing costs milliseconds where computing takes seconds. Cells are not compared:
/// none of our filters looks at them.
class ResultCache {
public:
  explicit ResultCache(int mebibytes = 256) { setLimit(mebibytes); }

  void setLimit(int mebibytes) {
    limit_ = std::size_t(mebibytes) << 10;
    shrink(limit_);
  }
  void clear() { shrink(0); }
  /// KiB, and number of results.
  std::size_t size() const { return held_; }
  std::size_t count() const { return entries_.size(); }

  /// Fills the outputs if the result for these inputs is known; else remembers the inputs for keep(), because
  /// a filter may move them to another time while it computes. stamp: of anything else that the result
  /// depends on.
  bool restore(vtkAlgorithm* filter, vtkInformationVector** inputs, vtkInformationVector* outputs,
               vtkMTimeType stamp = 0) {
    if (filter->GetMTime() != modified_ || stamp != stamp_) clear();
    for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
      if (!isOf(*entry, objectsOf(filter, inputs))) continue;
      for (int port = 0; port < int(entry->outputs.size()); ++port)
        copy(entry->outputs[std::size_t(port)], vtkDataObject::GetData(outputs, port));
      entries_.splice(entries_.begin(), entries_, entry);
      return true;
    }
    asked_ = Entry();
    if (limit_ == 0) return false;
    for (vtkDataObject* input : objectsOf(filter, inputs)) {
      asked_.inputs.push_back(copyOf(input));
      for (vtkAbstractArray* array : arraysOf(input)) asked_.times.push_back(array->GetMTime());
    }
    return false;
  }

  /// Keeps what the filter has just put out for the inputs that restore() did not know.
  void keep(vtkAlgorithm* filter, vtkInformationVector* outputs, vtkMTimeType stamp = 0) {
    if (filter->GetMTime() != modified_ || stamp != stamp_) clear();
    modified_ = filter->GetMTime();
    stamp_ = stamp;
    Entry entry = std::move(asked_);
    asked_ = Entry();
    if (limit_ == 0 || entry.inputs.empty()) return;
    for (int port = 0; port < filter->GetNumberOfOutputPorts(); ++port)
      entry.outputs.push_back(copyOf(vtkDataObject::GetData(outputs, port)));
    entry.kibibytes = memoryOf(entry);
    if (entry.kibibytes > limit_) return;
    shrink(limit_ - entry.kibibytes);
    held_ += entry.kibibytes;
    entries_.push_front(std::move(entry));
  }

private:
  using Object = vtkSmartPointer<vtkDataObject>;
  struct Entry {
    std::vector<Object> inputs, outputs;
    std::vector<vtkMTimeType> times; // of the inputs' arrays when they were used
    std::size_t kibibytes = 0;
  };

  /// Of all connections of all ports, in order.
  static std::vector<vtkDataObject*> objectsOf(vtkAlgorithm* filter, vtkInformationVector** inputs) {
    std::vector<vtkDataObject*> objects;
    for (int port = 0; port < filter->GetNumberOfInputPorts(); ++port)
      for (int c = 0; c < inputs[port]->GetNumberOfInformationObjects(); ++c)
        objects.push_back(vtkDataObject::GetData(inputs[port], c));
    return objects;
  }

  static void copy(vtkDataObject* from, vtkDataObject* to) {
    to->ShallowCopy(from);
    vtkInformation* information = from->GetInformation();
    if (information->Has(vtkDataObject::DATA_TIME_STEP()))
      to->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(),
                                information->Get(vtkDataObject::DATA_TIME_STEP()));
  }
  static Object copyOf(vtkDataObject* object) {
    Object made;
    if (!object) return made;
    made.TakeReference(object->NewInstance());
    copy(object, made);
    return made;
  }

  static std::vector<vtkFieldData*> fieldsOf(vtkDataObject* object) {
    std::vector<vtkFieldData*> fields{object->GetFieldData()};
    if (vtkDataSet* data = vtkDataSet::SafeDownCast(object))
      fields.insert(fields.end(), {data->GetPointData(), data->GetCellData()});
    if (vtkTable* table = vtkTable::SafeDownCast(object)) fields.push_back(table->GetRowData());
    return fields;
  }
  static std::vector<vtkAbstractArray*> arraysOf(vtkDataObject* object) {
    std::vector<vtkAbstractArray*> arrays;
    if (!object) return arrays;
    for (vtkFieldData* field : fieldsOf(object))
      for (int a = 0; a < field->GetNumberOfArrays(); ++a) arrays.push_back(field->GetAbstractArray(a));
    if (vtkPointSet* points = vtkPointSet::SafeDownCast(object))
      if (points->GetPoints()) arrays.push_back(points->GetPoints()->GetData());
    return arrays;
  }

  /// Each array once, however many of the inputs and outputs share it.
  static std::size_t memoryOf(const Entry& entry) {
    std::set<vtkAbstractArray*> all;
    for (const auto* objects : {&entry.inputs, &entry.outputs})
      for (const Object& object : *objects)
        for (vtkAbstractArray* array : arraysOf(object)) all.insert(array);
    std::size_t sum = 1;
    for (vtkAbstractArray* array : all) sum += array->GetActualMemorySize();
    return sum;
  }

  static bool sameLayout(vtkDataObject* a, vtkDataObject* b) {
    const auto timeOf = [](vtkDataObject* o) {
      vtkInformation* i = o->GetInformation();
      return i->Has(vtkDataObject::DATA_TIME_STEP()) ? i->Get(vtkDataObject::DATA_TIME_STEP()) : -1e300;
    };
    if (std::strcmp(a->GetClassName(), b->GetClassName()) != 0 || timeOf(a) != timeOf(b)) return false;
    vtkDataSet *da = vtkDataSet::SafeDownCast(a), *db = vtkDataSet::SafeDownCast(b);
    if (da) // which array a filter takes when none is named
      for (int t = 0; t < vtkDataSetAttributes::NUM_ATTRIBUTES; ++t) {
        const auto activeOf = [t](vtkDataSet* d) {
          vtkAbstractArray* array = d->GetPointData()->GetAbstractAttribute(t);
          return std::string(array && array->GetName() ? array->GetName() : "");
        };
        if (activeOf(da) != activeOf(db)) return false;
      }
    vtkImageData *ia = vtkImageData::SafeDownCast(a), *ib = vtkImageData::SafeDownCast(b);
    return !ia || (std::equal(ia->GetExtent(), ia->GetExtent() + 6, ib->GetExtent()) &&
                   std::equal(ia->GetSpacing(), ia->GetSpacing() + 3, ib->GetSpacing()) &&
                   std::equal(ia->GetOrigin(), ia->GetOrigin() + 3, ib->GetOrigin()));
  }

  static bool sameValues(vtkAbstractArray* a, vtkAbstractArray* b) {
    const char *nameA = a->GetName(), *nameB = b->GetName();
    if (std::strcmp(nameA ? nameA : "", nameB ? nameB : "") != 0 || a->GetDataType() != b->GetDataType() ||
        a->GetNumberOfComponents() != b->GetNumberOfComponents() ||
        a->GetNumberOfTuples() != b->GetNumberOfTuples())
      return false;
    if (vtkStringArray* text = vtkStringArray::SafeDownCast(a)) {
      for (vtkIdType i = 0; i < text->GetNumberOfValues(); ++i)
        if (text->GetValue(i) != vtkStringArray::SafeDownCast(b)->GetValue(i)) return false;
      return true;
    }
    if (!a->HasStandardMemoryLayout() || !b->HasStandardMemoryLayout()) return false;
    const auto bytes = std::size_t(a->GetNumberOfValues()) * std::size_t(a->GetDataTypeSize());
    return bytes == 0 || std::memcmp(a->GetVoidPointer(0), b->GetVoidPointer(0), bytes) == 0;
  }

  static bool isOf(const Entry& entry, const std::vector<vtkDataObject*>& inputs) {
    if (inputs.size() != entry.inputs.size()) return false;
    auto time = entry.times.begin();
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      if (!inputs[i] || !entry.inputs[i] || !sameLayout(inputs[i], entry.inputs[i])) return false;
      const auto now = arraysOf(inputs[i]), then = arraysOf(entry.inputs[i]);
      if (now.size() != then.size()) return false;
      for (std::size_t a = 0; a < now.size(); ++a, ++time) {
        if (then[a]->GetMTime() != *time) return false; // somebody wrote into it since
        if (now[a] != then[a] && !sameValues(now[a], then[a])) return false;
      }
    }
    return true;
  }

  void shrink(std::size_t to) {
    while (held_ > to) {
      held_ -= entries_.back().kibibytes;
      entries_.pop_back();
    }
  }

  std::list<Entry> entries_; // the latest first
  Entry asked_;              // the inputs of what is being computed
  std::size_t limit_ = 0, held_ = 0;
  vtkMTimeType modified_ = 0, stamp_ = 0;
};

} // namespace rimflow

#endif
